#!/usr/bin/env bash
# Installed: soundfile==0.14.0 (its wheel brings libsndfile), numpy==2.4.6.
# Expected: FLAC takes any whole rate up to a limit, like WAV: check_format("FLAC", "PCM_24") is true, 655 350 Hz is
# written, and libsndfile has a message of its own for rates that FLAC does not support.
# Happens: libsndfile keeps to FLAC's streamable subset, where each frame states the rate, above 65 535 Hz in tens
# of hertz only. 65 536 and 131 072 Hz, the powers of two of many FFT analysers, cannot be written, nor 97 656;
# 102 400 and 204 800 Hz can. The error speaks of a decoder while the file is written, and an empty file stays.
#   written: 32768 51200 65535 102400 131070 204800; refused: 65536 97656 131072 262144
# Why it matters: an archive that goes from WAV to FLAC works for years and stops at the first analyser of this
# kind. The rate must not be rounded to get past it: 65 530 for 65 536 Hz is 92 ppm, one turn in 11 000.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
install() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pins=(soundfile==0.14.0 numpy==2.4.6)
install "${pins[@]}" || { sleep 5; install "${pins[@]}"; } || { sleep 15; install "${pins[@]}"; }

venv/bin/python - <<'PY'
import os
import sys

import numpy as np
import soundfile

x = 0.5 * np.sin(np.arange(4096) / 7)
written, refused, said = [], [], set()
for rate in (32768, 51200, 65535, 65536, 97656, 102400, 131070, 131072, 204800, 262144):
    soundfile.write("run.wav", x, rate, subtype="PCM_24")
    name = f"{rate}.flac"
    try:
        soundfile.write(name, x, rate, subtype="PCM_24")
        written.append(rate)
    except soundfile.LibsndfileError as error:
        refused.append(rate)
        said.add(f"{error} ({os.path.getsize(name)} bytes left)")
print("soundfile", soundfile.__version__, "libsndfile", soundfile.__libsndfile_version__, "numpy", np.__version__)
print("written:", *written, end="; refused: ")
print(*refused)
print("\n".join(said))
if not soundfile.check_format("FLAC", "PCM_24") or refused != [65536, 97656, 131072, 262144]:
    sys.exit("behaviour has changed: other rates are refused than those that are no tens of hertz")
PY
