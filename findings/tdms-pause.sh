#!/usr/bin/env bash
# Installed: npTDMS==1.13.0, numpy==2.4.6.
# A recorder that is stopped and started again adds a segment to its TDMS file, with a new wf_start_time.
# Expected: time_track(absolute_time=True) begins at the first start; the second part begins after the pause.
# Happens: the properties of a channel are those of the LAST segment, and the axis is laid from there without a
# gap: the first sample is stamped with the start of the second part, and the pause is gone.
#   first sample recorded at 00:00:00, stamped 2026-01-01T00:00:10.000000; step over the pause 0.00002 s
# Why it matters: vibration is joined with loads, alarms and other recorders by these stamps. Here each sample
# of the first part is 10 s late, and a phase carried over the seam of the parts is wrong. No warning is given.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
install() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pins=(npTDMS==1.13.0 numpy==2.4.6)
install "${pins[@]}" || { sleep 5; install "${pins[@]}"; } || { sleep 15; install "${pins[@]}"; }

venv/bin/python - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter

RATE, COUNT = 51200, 512
starts = [np.datetime64("2026-01-01T00:00:00"), np.datetime64("2026-01-01T00:00:10")]
with TdmsWriter("run.tdms") as writer:
    for start in starts:
        properties = {"wf_start_time": start, "wf_start_offset": 0.0, "wf_increment": 1 / RATE}
        writer.write_segment([ChannelObject("run", "acc", np.zeros(COUNT), properties=properties)])

times = TdmsFile.read("run.tdms")["run"]["acc"].time_track(absolute_time=True, accuracy="us")
step = (times[COUNT] - times[COUNT - 1]) / np.timedelta64(1, "s")
print("npTDMS", version("npTDMS"), "numpy", version("numpy"))
print(f"first sample recorded at 00:00:00, stamped {times[0]}; step over the pause {step:.5f} s")
if times[0] != starts[1] or step > 2 / RATE:
    sys.exit("behaviour has changed: the axis no longer begins at the start of the last segment")
PY
