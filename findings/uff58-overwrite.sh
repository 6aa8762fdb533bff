#!/usr/bin/env bash
# Installed: pyuff==2.5.8, numpy==2.4.6.
# Expected: write_sets(sets, mode="overwrite") replaces the file and writes all the sets, in text and in binary.
# Happens: a binary set is written in three steps (header, samples, closing line), and with "overwrite" each step
# opens the file anew and empties it. One set leaves the closing line alone, of two sets the second one stays,
# behind a stray line that hides it. The call returns without a word; in text both sets are there.
#   text: 2 of 2 sets, binary: 0 of 2; one binary set leaves b'    -1\n'
# Why it matters: binary set 58 is how test laboratories hand on long vibration records, and "overwrite" is the
# natural mode for a script that may run twice. The record is lost when the script ends. mode="add" is right.
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


def record(binary, gain):
    x = np.arange(1024) / 25600
    return pyuff.prepare_58(
        binary=binary, func_type=1, id1="run", rsp_node=1, rsp_dir=3, ref_node=1, ref_dir=3,
        data=gain * np.sin(x), x=x, abscissa_spacing=1, abscissa_spec_data_type=17,
        ordinate_spec_data_type=12, orddenom_spec_data_type=0, z_axis_spec_data_type=0)


def write(name, binary, gains):
    pyuff.UFF(name).write_sets([record(binary, gain) for gain in gains], mode="overwrite")
    return int(np.sum(np.asarray(pyuff.UFF(name).get_set_types()) == 58))


text, binary = write("text.uff", 0, [1, 2]), write("binary.uff", 1, [1, 2])
write("one.uff", 1, [1])
rest = open("one.uff", "rb").read()
print("pyuff", version("pyuff"), "numpy", version("numpy"))
print(f"text: {text} of 2 sets, binary: {binary} of 2; one binary set leaves {rest}")
if text != 2 or binary != 0 or rest.strip() != b"-1":
    sys.exit("behaviour has changed: overwrite no longer loses binary sets")
PY
