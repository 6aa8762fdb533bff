#!/usr/bin/env bash
# Installed: pyuff==2.5.8, numpy==2.4.6.
# Expected: write_sets(..., force_double=False) writes a set with ord_data_type=2 in single precision, in binary too,
# and pyuff reads what it wrote.
# Happens: in text it does. In binary the head announces singles (type 2, four bytes a sample), but the samples are
# doubles all the same and the file is no smaller. pyuff believes the type, not the count: it returns each double as
# two meaningless singles, twice as many samples and times as num_pts says, some not even numbers. No error.
#   head: type 2, 4096 bytes for 1024 samples; stored: 8192 bytes of doubles; read: 2048 samples
# Why it matters: single precision is enough for vibration and halves a record, so it is asked for with long ones, and
# the record seems to last twice as long. The samples are not lost: with type 4 in the head they read exactly. The
# default, force_double=True, is right.
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
from pathlib import Path

import numpy as np
import pyuff

COUNT = 1024
x = np.arange(COUNT) / 25600
samples = np.sin(900 * x)


def write(name, binary, double):
    record = pyuff.prepare_58(
        binary=binary, func_type=1, id1="run", rsp_node=1, rsp_dir=3, ref_node=1, ref_dir=3,
        data=samples, x=x, abscissa_spacing=1, abscissa_spec_data_type=17, ord_data_type=2,
        ordinate_spec_data_type=12, orddenom_spec_data_type=0, z_axis_spec_data_type=0)
    pyuff.UFF(name).write_sets([record], mode="add", force_double=double)


def show(name):
    own = pyuff.UFF(f"{name}.uff").read_sets()
    data = own["data"]
    off = f"off by {np.max(np.abs(data - samples)):.1g}" if len(data) == COUNT else "not the samples"
    return f"type {own['ord_data_type']}, num_pts {own['num_pts']}, {len(data)} read, {off}", own


write("text.uff", 0, False)
write("double.uff", 1, True)
write("single.uff", 1, False)
raw = Path("single.uff").read_bytes()
lines = raw.split(b"\n")
announced, kind = int(lines[1].split()[4]), int(lines[8].split()[0])
stored = 8 * COUNT if samples.astype("<f8").tobytes() in raw else 0
sizes = [Path(name).stat().st_size for name in ("single.uff", "double.uff")]
Path("mended.uff").write_bytes(raw.replace(lines[8], b"%10d" % 4 + lines[8][10:], 1))
seen = {}
print("pyuff", version("pyuff"), "numpy", version("numpy"))
print(f"head: type {kind}, {announced} bytes for {COUNT} samples; stored: {stored} bytes of doubles;", *sizes, "in all")
for name in ("text", "double", "single", "mended"):
    seen[name], own = show(name)
    print(f"{name}: {seen[name]}")
    if name == "single":
        spread = own["x"][-1] - own["x"][0]
        odd = int(np.sum(~np.isfinite(own["data"])))
        print(f"  lasts {spread:.3f} s for {x[-1]:.3f}; {odd} values are no numbers; the first: {own['data'][:4]}")
if kind != 2 or announced != 4 * COUNT or stored != 8 * COUNT or sizes[0] != sizes[1]:
    sys.exit("behaviour has changed: head and samples of a binary single-precision set are others")
if seen["single"] != f"type 2, num_pts {COUNT}, {2 * COUNT} read, not the samples":
    sys.exit("behaviour has changed: pyuff reads its binary single-precision set otherwise")
sound = f"type 4, num_pts {COUNT}, {COUNT} read, off by 0"
text = f"type 2, num_pts {COUNT}, {COUNT} read, off by"
if not seen["text"].startswith(text) or {seen["double"], seen["mended"]} != {sound}:
    sys.exit("behaviour has changed: text, double or mended set")
PY
