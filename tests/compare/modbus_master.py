"""A Modbus RTU master for the tests: pymodbus, told what to ask by lines at its input, over TCP to a bridge that has the serial line.

    modbus_master.py PORT ADDRESS        where the bridge listens, the node's address

Lines: `read FUNCTION FIRST COUNT`, `long FIRST`, `float FIRST` (two input registers, as pymodbus puts them together), `write FUNCTION FIRST
VALUE`, `identity` (function 43). Answers: the values in a line, `exception NUMBER`, or `error WHAT`.
"""
import sys

from pymodbus.client import ModbusTcpClient
from pymodbus.framer import FramerType

client = ModbusTcpClient("127.0.0.1", port=int(sys.argv[1]), framer=FramerType.RTU, timeout=60, retries=0)
device = int(sys.argv[2])


def answer(words):
    """What is answered to one line."""
    command, *numbers = words
    numbers = [int(number) for number in numbers]
    kinds = {"long": client.DATATYPE.UINT32, "float": client.DATATYPE.FLOAT32}
    if command == "read":
        function, first, count = numbers
        call = {1: client.read_coils, 2: client.read_discrete_inputs, 3: client.read_holding_registers, 4: client.read_input_registers}[function]
        reply = call(first, count=count, device_id=device)
    elif command in kinds:
        reply = client.read_input_registers(numbers[0], count=2, device_id=device)
    elif command == "write":
        function, first, value = numbers
        calls = {
            5: lambda: client.write_coil(first, bool(value), device_id=device),
            6: lambda: client.write_register(first, value, device_id=device),
            15: lambda: client.write_coils(first, [bool(value)] * 9, device_id=device),
            16: lambda: client.write_registers(first, [value] * 3, device_id=device),
        }
        reply = calls[function]()
    elif command == "identity":
        reply = client.read_device_information(device_id=device)
    else:
        return f"error no such command: {command}"
    if reply.isError():
        return f"exception {reply.exception_code}"
    if command in kinds:
        return repr(client.convert_from_registers(reply.registers, kinds[command]))
    values = reply.bits[:numbers[2]] if command == "read" and numbers[0] <= 2 else reply.registers
    return " ".join(str(int(value)) for value in values)


client.connect()
for line in sys.stdin:
    try:
        print(answer(line.split()), flush=True)
    except Exception as error:  # pylint: disable=broad-except
        print(f"error {type(error).__name__}: {error}".replace("\n", " "), flush=True)
