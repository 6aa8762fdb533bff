#!/usr/bin/env bash
# Installed: pyuff==2.5.8, numpy==2.4.6. No option is set but the ones the call asks for.
# Expected: a record of evenly spaced samples keeps its time axis; 12 digits of amplitude promise as much of time.
# Happens: unless abscissa_spacing=1 is given, pyuff writes pairs of time and value and gives the time 6 digits,
# as the format has it (E13.5 beside E20.12). 100 s into a record at 25.6 kHz 26 samples share one stamp.
# With abscissa_spacing=1 the samples are even, but the header's step has 6 digits also: 51 200 Hz is not there.
#   pairs: 11 distinct times in 256 samples at 100 s; even: 51199.869 Hz instead of 51200
# Why it matters: a rate from the differences of the pairs is 0/0 or hundreds of Hz. The 2.6 ppm of the even form
# are 9.2 ms after an hour, nine periods of a mesh line at 1 kHz against a recorder with an exact rate. Text and
# binary share that header. Readers should round the rate, or take it from elsewhere.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
install() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pins=(pyuff==2.5.8 numpy==2.4.6)
install "${pins[@]}" || { sleep 5; install "${pins[@]}"; } || { sleep 15; install "${pins[@]}"; }

venv/bin/python - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pyuff


def write_and_read(name, x, **more):
    pyuff.UFF(name).write_sets(pyuff.prepare_58(
        func_type=1, id1="run", rsp_node=1, rsp_dir=3, ref_node=1, ref_dir=3, data=np.sin(x), x=x,
        abscissa_spec_data_type=17, ordinate_spec_data_type=12, orddenom_spec_data_type=0,
        z_axis_spec_data_type=0, **more))
    return pyuff.UFF(name).read_sets()


late = write_and_read("pairs.uff", 100 + np.arange(256) / 25600)
even = write_and_read("even.uff", np.arange(1024) / 51200, binary=1, abscissa_spacing=1)
distinct, rate = len(np.unique(late["x"])), 1 / even["abscissa_inc"]
print("pyuff", version("pyuff"), "numpy", version("numpy"))
print(f"pairs: {distinct} distinct times in 256 samples at 100 s; even: {rate:.3f} Hz instead of 51200")
if distinct > 12 or abs(rate - 51200) < 0.05:
    sys.exit("behaviour has changed: time in set 58 has more than six digits")
PY
