#!/usr/bin/env bash
# Installed: minimalmodbus==2.1.1, pyserial==3.5.
# Expected: a Modbus RTU master that knows rate and number of registers waits as long as the answer lasts on the line,
# or says "timeout".
# Happens: the default of 0.05 s is for the whole answer, from its first byte to its last, whatever the rate is. 66
# registers last 78 ms at 19 200 bit/s: the master reads what has come by then and says "Checksum error in rtu mode".
# The answer is sound: with timeout = 1 the same station is read. At 115 200 bit/s the default will do.
#   19200 bit/s, 66 registers: InvalidResponseError Checksum error in rtu mode; with timeout 1 s: read; 115200: read
# Why it matters: whoever reads a sensor's table of results in one request looks for noise on the bus, cable and
# terminators, where the cure is a line of the program.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
install() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pins=(minimalmodbus==2.1.1 pyserial==3.5)
install "${pins[@]}" || { sleep 5; install "${pins[@]}"; } || { sleep 15; install "${pins[@]}"; }

venv/bin/python - <<'PY'
import os
import pty
import sys
import threading
import time
import tty
from importlib.metadata import version

import minimalmodbus

REGISTERS = 66
BITS = 11


def checksum(frame):
    rest = 0xFFFF
    for byte in frame:
        rest ^= byte
        for _ in range(8):
            rest = (rest >> 1) ^ (0xA001 if rest & 1 else 0)
    return rest.to_bytes(2, "little")


def station(line, rate):
    """Answers one request of eight bytes, byte by byte as fast as the line's rate carries them."""
    request = b""
    while len(request) < 8:
        request += os.read(line, 8 - len(request))
    answer = bytes([1, 4, 2 * REGISTERS]) + bytes(2 * REGISTERS)
    answer += checksum(answer)
    start = time.monotonic()
    for number, byte in enumerate(answer, 1):
        time.sleep(max(0.0, start + number * BITS / rate - time.monotonic()))
        os.write(line, bytes([byte]))


def read(rate, timeout=None):
    line, port = pty.openpty()
    tty.setraw(line)
    tty.setraw(port)
    master = minimalmodbus.Instrument(os.ttyname(port), 1)
    master.serial.baudrate = rate
    if timeout:
        master.serial.timeout = timeout
    answering = threading.Thread(target=station, args=(line, rate))
    answering.start()
    try:
        return "read" if master.read_registers(0, REGISTERS, functioncode=4) == [0] * REGISTERS else "other values"
    except minimalmodbus.ModbusException as error:
        return f"{type(error).__name__} {str(error).split('.')[0].split(':')[0]}"
    finally:
        answering.join()
        master.serial.close()
        os.close(line)
        os.close(port)


slow, patient, fast = read(19_200), read(19_200, timeout=1.0), read(115_200)
print(*(f"{name} {version(name)}" for name in ("minimalmodbus", "pyserial")))
print(f"19200 bit/s, {REGISTERS} registers: {slow}; with timeout 1 s: {patient}; 115200: {fast}")
if "Checksum error" not in slow or (patient, fast) != ("read", "read"):
    sys.exit("behaviour has changed: a long answer is waited for")
PY
