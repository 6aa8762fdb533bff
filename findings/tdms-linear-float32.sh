#!/usr/bin/env bash
# Installed: npTDMS==1.13.0, numpy==2.4.6.
# Expected: a channel with an NI scale gives doubles: the scale's factors are doubles and channel.dtype says float64.
# Happens: single-precision samples under a linear scale are calculated in single precision and come as float32;
# only an empty slice is float64. The same line as a polynomial of two coefficients gives true doubles. By the
# slope alone the values are up to 6e-8 (relative) off; where the offset cancels a bias, 2e-6 of the peak here.
#   linear: says float64, gives float32, off by 1.8e-06 of the peak; polynomial: float64, off by 0
# Why it matters: displacement probes sit at -10 V with some tenths of a volt of vibration on it, so the offset cancels
# nearly all. A comparison of two readers at double accuracy fails, and samples that are written as bytes and read
# back as channel.dtype are half as many and nonsense, without an error. raw_data made doubles and scaled is right.
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
from nptdms.types import Uint32

# A displacement probe of 7.87 mV/um at a gap voltage of -10 V.
SLOPE = 1 / 0.00787
OFFSET = 10 * SLOPE
volts = (0.4 * np.sin(np.arange(10000) / 7) - 10).astype("f4")
RAW = Uint32(0xFFFFFFFF)


def scale(kind, **fields):
    head = {"NI_Scaling_Status": "unscaled", "NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": kind}
    return head | {f"NI_Scale[0]_{kind}_{key}": value for key, value in fields.items()}


def linear(offset):
    return scale("Linear", Slope=SLOPE, Y_Intercept=offset, Input_Source=RAW)


factors = {"Coefficients_Size": 2, "Coefficients[0]": OFFSET, "Coefficients[1]": SLOPE}
polynomial = scale("Polynomial", Input_Source=RAW, **factors)
channels = {"linear": linear(OFFSET), "slope": linear(0.0), "polynomial": polynomial}
with TdmsWriter("run.tdms") as writer:
    writer.write_segment([ChannelObject("run", name, volts, scaled) for name, scaled in channels.items()])

group = TdmsFile.read("run.tdms")["run"]
double = volts.astype("f8") * SLOPE + OFFSET
print("npTDMS", version("npTDMS"), "numpy", version("numpy"))
off = {}
for name in ("linear", "polynomial"):
    off[name] = np.max(np.abs(group[name][:] - double)) / np.max(np.abs(double))
    print(f"{name}: says {group[name].dtype}, gives {group[name][:].dtype}, off by {off[name]:.2g} of the peak")
exact = volts.astype("f8") * SLOPE
relative = np.max(np.abs(group["slope"][:] / exact - 1))
again = np.frombuffer(group["linear"][:].tobytes(), group["linear"].dtype)
print(f"slope alone: off by {relative:.2g}; bytes read back as channel.dtype: {len(again)} of {len(volts)} samples")
with TdmsFile.open("run.tdms") as file:
    lazy = file["run"]["linear"]
    kinds = [str(values.dtype) for values in (lazy[:], lazy.read_data(0, 10), lazy[0:0])]
print("opened lazily: all, ten and no samples are", *kinds)
if any(group[name].dtype != "f8" for name in channels) or group["polynomial"][:].dtype != "f8":
    sys.exit("behaviour has changed: channel.dtype or the polynomial is no longer float64")
if group["linear"][:].dtype != "f4" or kinds != ["float32", "float32", "float64"] or 2 * len(again) != len(volts):
    sys.exit("behaviour has changed: a linear scale no longer gives float32")
if off["polynomial"] > 1e-12 or not 1e-6 < off["linear"] < 1e-5 or not 1e-8 < relative < 1e-7:
    sys.exit("behaviour has changed: other errors against double arithmetic")
PY
