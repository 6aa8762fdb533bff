#!/usr/bin/env bash
# Installed: pysparkplug==0.6.1, paho-mqtt==1.6.1, protobuf==6.33.1.
# Expected: a Sparkplug library reads the data messages that it writes itself.
# Happens: encode() leaves the data type out of NDATA and DDATA, as the specification allows (the birth has told
# it), but decode() keeps no births and looks for the type in the message: NotImplementedError for each metric.
# Births are read. A message that repeats the types, encode(include_dtypes=True), is read too.
#   DBirth read; DData: NotImplementedError UNKNOWN not implemented; DData with types read
# Why it matters: a fleet of vibration sensors that saves bytes by the book cannot be read by this client, though
# its births can: the devices appear and no value ever comes. Gateways have to repeat the types for it.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
install() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pins=(pysparkplug==0.6.1 paho-mqtt==1.6.1 protobuf==6.33.1)
install "${pins[@]}" || { sleep 5; install "${pins[@]}"; } || { sleep 15; install "${pins[@]}"; }

venv/bin/python - <<'PY'
import sys
from importlib.metadata import version

import pysparkplug as sparkplug

metric = sparkplug.Metric(timestamp=1, name="rms", datatype=sparkplug.DataType.FLOAT, value=1.5, alias=7)


def read_back(kind, **options):
    payload = kind(timestamp=1, seq=1, metrics=(metric,)).encode(**options)
    try:
        return "read" if kind.decode(payload).metrics[0].value == 1.5 else "another value"
    except NotImplementedError as error:
        return f"NotImplementedError {error}"


birth = read_back(sparkplug.DBirth)
data = read_back(sparkplug.DData)
typed = read_back(sparkplug.DData, include_dtypes=True)
print(*(f"{name} {version(name)}" for name in ("pysparkplug", "paho-mqtt", "protobuf")))
print(f"DBirth {birth}; DData: {data}; DData with types {typed}")
if (birth, typed) != ("read", "read") or not data.startswith("NotImplementedError"):
    sys.exit("behaviour has changed: data messages without types are read")
PY
