#!/usr/bin/env bash
# Installed: unicorn==2.1.4 (the Unicorn CPU emulator with its Python binding).
# Expected: an engine opened with THUMB | MCLASS and set to UC_CPU_ARM_CORTEX_M4 is a Cortex-M4.
# Happens: with MCLASS in the mode the chosen model is ignored without an error: each model is a Cortex-M33, even
# the M0. vmaxnm (FPv5) and sg (ARMv8-M) run, which a Cortex-M4 refuses; the M0 adds floats. With THUMB
# alone the choice is obeyed. Reading the model back tells the two apart.
#   THUMB|MCLASS: asked 9, is 11, vmaxnm runs; THUMB: asked 9, is 9, vmaxnm refused
# Why it matters: firmware of vibration sensors is tried in such an emulator before there is a board. An image built
# for the wrong core, or a DSP library with M7 or M33 instructions, passes all tests and faults on the chip.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
install() { venv/bin/pip install --quiet --disable-pip-version-check "$@"; }
pins=(unicorn==2.1.4)
install "${pins[@]}" || { sleep 5; install "${pins[@]}"; } || { sleep 15; install "${pins[@]}"; }

venv/bin/python - <<'PY'
import sys

import unicorn
from unicorn import UC_ARCH_ARM, UC_MODE_MCLASS, UC_MODE_THUMB, Uc, UcError
from unicorn import arm_const as arm

FLASH = 0x0800_0000
VMAXNM = bytes.fromhex("80fe200a")  # vmaxnm.f32 s0, s0, s1
VADD = bytes.fromhex("30ee200a")  # vadd.f32 s0, s0, s1


def run(mode, model, code):
    engine = Uc(UC_ARCH_ARM, mode)
    engine.ctl_set_cpu_model(model)
    engine.mem_map(FLASH, 0x1000)
    engine.mem_write(FLASH, code)
    try:
        engine.emu_start(FLASH | 1, FLASH + len(code))
        result = "runs"
    except UcError:
        result = "refused"
    return engine.ctl_get_cpu_model(), result


m0, m4, m33 = arm.UC_CPU_ARM_CORTEX_M0, arm.UC_CPU_ARM_CORTEX_M4, arm.UC_CPU_ARM_CORTEX_M33
both, thumb = UC_MODE_THUMB | UC_MODE_MCLASS, UC_MODE_THUMB
wrong, right = run(both, m4, VMAXNM), run(thumb, m4, VMAXNM)
wrong_m0, right_m0 = run(both, m0, VADD), run(thumb, m0, VADD)
print("unicorn", unicorn.__version__, "models: M0", m0, "M4", m4, "M33", m33)
print("THUMB|MCLASS: asked %d, is %d, vmaxnm %s; " % (m4, *wrong) + "THUMB: asked %d, is %d, vmaxnm %s" % (m4, *right))
print("THUMB|MCLASS: asked %d, is %d, vadd.f32 %s; " % (m0, *wrong_m0)
      + "THUMB: asked %d, is %d, vadd.f32 %s" % (m0, *right_m0))
if wrong != (m33, "runs") or right != (m4, "refused"):
    sys.exit("behaviour has changed: the model is obeyed with MCLASS, or not without it")
PY
