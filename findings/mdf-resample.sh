#!/usr/bin/env bash
# Installed: asammdf==8.8.28, numpy==2.4.6, pandas==3.1.1.
# An acceleration is stored as MDF files hold it: 16-bit counts with a linear conversion to m/s2.
# Expected: get() gives it as floats in m/s2, so the default for floats, straight lines, holds for it, and
# MDF.resample(raster) and MDF.to_dataframe(raster=raster) agree.
# Happens: resample() works on the counts, takes the default for integers and repeats the former sample;
# to_dataframe() converts first and draws straight lines. The same values stored as floats are linear in both.
#   resample [0, 0, 1, 1, 0, 0], to_dataframe [0, 0.5, 1, 0.5, 0, 0.5], floats in resample [0, 0.5, 1, 0.5, 0, 0.5]
# Why it matters: a record brought to the rate of another one becomes stairs: half a sample late against the float
# channels beside it, with images of each line around the old rate. Nothing but the storage type decides.
# configure(integer_interpolation=2) gives lines, but of whole counts, cut towards zero: 0.49 m/s2 for 0.5.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
install() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pins=(asammdf==8.8.28 numpy==2.4.6 pandas==3.1.1)
install "${pins[@]}" || { sleep 5; install "${pins[@]}"; } || { sleep 15; install "${pins[@]}"; }

venv/bin/python - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from asammdf import MDF, Signal

RASTER = 0.05
times = np.arange(20) / 10
counts = np.array([0, 100] * 10, dtype=np.int16)
mdf = MDF(version="4.10")
mdf.append([
    Signal(counts, times, name="acc", unit="m/s2", conversion={"a": 0.01, "b": 0.0}),
    Signal(counts * 0.01, times, name="acc_float", unit="m/s2"),
])
mdf.save("run.mf4")


def show(values):
    return [float(f"{value:g}") for value in values[:6]]


with MDF("run.mf4") as read:
    resampled = read.resample(RASTER)
    stairs = show(resampled.get("acc").samples)
    floats = show(resampled.get("acc_float").samples)
    frame = show(read.to_dataframe(raster=RASTER)["acc"].to_numpy())
    read.configure(integer_interpolation=2)
    hybrid = show(read.resample(RASTER).get("acc").samples)
print("asammdf", version("asammdf"), "numpy", version("numpy"), "pandas", version("pandas"))
print(f"resample {stairs}, to_dataframe {frame}, floats in resample {floats}")
print(f"resample with integer_interpolation=2 {hybrid}")
if stairs == frame or floats != frame:
    sys.exit("behaviour has changed: resample and to_dataframe agree on converted counts")
PY
