"""A PLC's programmer with nothing but the csv map: reads every value of a node, group by group, and prints them as JSON.

    modbus_map.py MAP.csv tcp HOST PORT ADDRESS
    modbus_map.py MAP.csv rtu PATH ADDRESS

With WRITE=NUMBER in front it writes the command register first; with SAMPLES=COUNT it reads as many samples of the
waveform, too.
"""
import csv
import json
import struct
import sys

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

options = dict(word.split("=") for word in sys.argv[1:] if "=" in word)
path, kind, *place = (word for word in sys.argv[1:] if "=" not in word)
if kind == "tcp":
    client = ModbusTcpClient(place[0], port=int(place[1]), timeout=20, retries=3)
else:
    # A pseudo-terminal has no parity; a board has even parity by default.
    client = ModbusSerialClient(place[0], baudrate=19200, parity="N", timeout=20, retries=3)
device = int(place[-1])
assert client.connect(), "no connection"

with open(path, newline="", encoding="utf-8") as file:
    rows = list(csv.DictReader(file))
for row in rows:
    for key in ("function", "address", "count"):
        row[key] = int(row[key])


def words(row):
    """What one request gives."""
    call = {2: client.read_discrete_inputs, 4: client.read_input_registers}[row["function"]]
    reply = call(row["address"], count=row["count"], device_id=device)
    assert not reply.isError(), f"{row['name']}: {reply}"
    return reply.bits if row["function"] == 2 else reply.registers


def value(row, read):
    """The words of a value as the map says they are read."""
    if row["type"] == "bit":
        return bool(read[0])
    if row["type"] == "uint16":
        return read[0]
    raw = struct.pack(">HH", *read[:2])
    return struct.unpack(">f" if row["type"] == "float32" else ">I", raw)[0]


found = {}
places = {f"{row['group']}/{row['name']}": row for row in rows}
if "WRITE" in options:
    reply = client.write_registers(places["command/command"]["address"], [int(options["WRITE"])], device_id=device)
    found["written"] = f"exception {reply.exception_code}" if reply.isError() else "yes"
if "SAMPLES" in options:
    first, count = places["waveform samples/sample_1"]["address"], 2 * int(options["SAMPLES"])
    read = []
    for offset in range(0, count, 120):
        reply = client.read_input_registers(first + offset, count=min(120, count - offset), device_id=device)
        assert not reply.isError(), reply
        read += reply.registers
    samples = client.convert_from_registers(read, client.DATATYPE.FLOAT32)
    found["samples"] = [None if sample != sample else sample for sample in samples]
for row in rows:
    number = value(row, words(row))
    found[f"{row['group']}/{row['name']}"] = None if number != number else number
print(json.dumps(found))
