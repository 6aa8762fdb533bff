#!/usr/bin/env bash
# Installed: sdypy-io-tdms==0.1.2, sdypy-sep005==1.0.1, npTDMS==1.13.0, numpy==2.4.6.
# Expected: read_tdms gives each channel of a TDMS file with its name and start, write_tdms gives them on.
# Happens: starts are cut to whole seconds, wf_start_offset is not looked at, and a name is cut two
# characters before its first slash. write_tdms leaves the start out altogether and makes 32-bit floats.
#   starts 00:00:00.10 and 00:00:00.95 read as 00:00:00 and 00:00:00; 'DE m/s2' read as 'DE'; written on: no start
# Why it matters: an accelerometer and a tachometer of one file that began 0.85 s apart count as begun together:
# at 25 turns/s each angle is 21 turns off. Channels 'DE m/s2' and 'DE m/s' get one name. npTDMS below it
# has all of this right.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
install() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pins=(sdypy-io-tdms==0.1.2 sdypy-sep005==1.0.1 npTDMS==1.13.0 numpy==2.4.6)
install "${pins[@]}" || { sleep 5; install "${pins[@]}"; } || { sleep 15; install "${pins[@]}"; }

venv/bin/python - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter
from sdypy_io_tdms.tdms import read_tdms, write_tdms

STARTS = {"DE m/s2": "2026-01-01T00:00:00.10", "tach": "2026-01-01T00:00:00.95"}
channels = [
    ChannelObject("run", name, np.arange(4.0), properties={
        "wf_start_time": np.datetime64(start), "wf_start_offset": 0.0, "wf_increment": 1 / 51200,
        "unit_string": "V"})
    for name, start in STARTS.items()
]
with TdmsWriter("run.tdms") as writer:
    writer.write_segment(channels)

below = [str(channel.properties["wf_start_time"]) for channel in TdmsFile.read("run.tdms")["run"].channels()]
signals = read_tdms("run.tdms")
starts = [str(signal["start_timestamp"]) for signal in signals]
name = str(signals[0]["name"])
write_tdms(signals, "again.tdms")
kept = any("wf_start_time" in channel.properties for channel in TdmsFile.read("again.tdms")["run"].channels())
print(*(f"{package} {version(package)}" for package in ("sdypy-io-tdms", "sdypy-sep005", "npTDMS", "numpy")))
print("npTDMS reads the starts", *below)
print("sdypy-io-tdms reads", *starts, f"and 'DE m/s2' as {name!r}; written on:", "a start" if kept else "no start")
if starts != ["2026-01-01T00:00:00"] * 2 or name != "DE" or kept:
    sys.exit("behaviour has changed: the start, or the name with a slash, is kept")
PY
