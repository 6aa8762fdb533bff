"""libmodbus (C, by ctypes) against a served node: a float, the strongest line, a waveform, and an acknowledgement.

    libmodbus.py MAP.csv HOST PORT

The node needs `[modbus] commands = true`, `[capture] keep = "Fixed"` and an alarm that stands (book/src/howto/modbus.md).
Prints what it read; ends with 1 where something is not as the map says.
"""
import csv
import ctypes
import ctypes.util
import math
import sys

path, host, port = sys.argv[1:]
library = ctypes.CDLL(ctypes.util.find_library("modbus") or "libmodbus.so.5", use_errno=True)
library.modbus_new_tcp.restype = ctypes.c_void_p
library.modbus_strerror.restype = ctypes.c_char_p
library.modbus_get_float_abcd.restype = ctypes.c_float
context = ctypes.c_void_p(library.modbus_new_tcp(host.encode(), int(port)))
library.modbus_set_response_timeout(context, 20, 0)


def checked(result):
    if result < 0:
        sys.exit(library.modbus_strerror(ctypes.get_errno()).decode())
    return result


checked(library.modbus_connect(context))
with open(path, newline="", encoding="utf-8") as file:
    places = {f"{row['group']}/{row['name']}": int(row["address"]) for row in csv.DictReader(file)}


def registers(first, count):
    words = (ctypes.c_uint16 * count)()
    checked(library.modbus_read_input_registers(context, first, count, words))
    return words


def floats(first, count):
    words = registers(first, 2 * count)
    pair = ctypes.POINTER(ctypes.c_uint16)
    at = [ctypes.cast(ctypes.byref(words, 4 * n), pair) for n in range(count)]
    return [library.modbus_get_float_abcd(words) for words in at]


def bit(name):
    bits = (ctypes.c_uint8 * 1)()
    checked(library.modbus_read_input_bits(context, places[f"discrete inputs/{name}"], 1, bits))
    return bits[0]


print("RMS, m/s2:", floats(places["values/rms"], 1)[0])
print("strongest line, Hz and m/s2:", floats(places["strongest lines/line_1_frequency"], 2))
phase = registers(places["waveform/phase"], 1)[0]
samples = [x for n in range(0, 600, 60) for x in floats(places["waveform samples/sample_1"] + 2 * n, 60)]
rms = math.sqrt(sum(x * x for x in samples) / len(samples))
print(f"waveform: phase {phase}, RMS of {len(samples)} samples {rms:.4g} m/s2")
unseen = bit("unseen_1")
one = (ctypes.c_uint16 * 1)(1)
checked(library.modbus_write_registers(context, places["command/command"], 1, one))
print("unseen before and after the acknowledgement:", unseen, bit("unseen_1"))
sys.exit(not (phase == 4 and rms > 0 and unseen == 1 and bit("unseen_1") == 0))
