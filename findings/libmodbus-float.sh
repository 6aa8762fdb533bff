#!/usr/bin/env bash
# Installed: Debian 12's libmodbus5, 3.1.6-2.1+deb12u1, unpacked in a temporary folder; Python's ctypes calls it.
# Expected: modbus_get_float() reads the example of its own manual page: words 0x4465 and 0x229a are 916.540649; and
# modbus_get_float_dcba(), by which the page says it has been replaced, reads the same words as the same number.
# Happens: there are three answers. modbus_get_float() takes the low word first, as _cdab does, and neither of the
# two is the DCBA order of the page; only modbus_get_float_abcd() reads the page's example.
#   0x4465 0x229a: modbus_get_float 4.181e-18, _dcba -3.358e-23, _cdab 4.181e-18, _abcd 916.5
#   0x47f1 0x2000 (example of _dcba, 123456): _dcba 3.025e-39, _abcd 123456
# Why it matters: a sensor that sends its floats high word first, as most maps do, is read as noise about zero by the
# function with the plainest name, and still by the one that its manual sends the reader to.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
chmod 755 .
get() { apt-get -o APT::Sandbox::User=root download -qq libmodbus5=3.1.6-2.1+deb12u1; }
get || { sleep 5; get; } || { sleep 15; get; }
dpkg -x libmodbus5_*.deb .

python3 - "$(find . -name 'libmodbus.so.5' | head -1)" <<'PY'
import ctypes
import sys

library = ctypes.CDLL(sys.argv[1])


def read(order, *words):
    function = getattr(library, f"modbus_get_float{order}")
    function.restype = ctypes.c_float
    return function((ctypes.c_uint16 * 2)(*words))


of_page = {order: read(order, 0x4465, 0x229A) for order in ("", "_dcba", "_cdab", "_abcd")}
of_dcba = {order: read(order, 0x47F1, 0x2000) for order in ("_dcba", "_abcd")}
print("libmodbus 3.1.6")
print("0x4465 0x229a:", ", ".join(f"modbus_get_float{order} {value:.4g}" for order, value in of_page.items()))
print("0x47f1 0x2000:", ", ".join(f"modbus_get_float{order} {value:.6g}" for order, value in of_dcba.items()))
right = abs(of_page["_abcd"] - 916.540649) < 1e-4 and of_dcba["_abcd"] == 123456.0
if not right or of_page[""] != of_page["_cdab"] or abs(of_page["_dcba"]) > 1 or abs(of_dcba["_dcba"]) > 1:
    sys.exit("behaviour has changed: the examples of the manual pages are read")
PY
