"""The loop from Python and from the command."""

import json
import subprocess

import numpy as np
import pytest

import meshband


@pytest.fixture(scope="module")
def folder(machine, tmp_path_factory):
    """A record without a machine: tooth counts and a tach, with a passage at order 3.58 of the pinion."""
    rate, speed, seconds = 25_600.0, 20.0, 12.0
    random = np.random.default_rng(5)
    t = np.arange(int(seconds * rate)) / rate
    x = 0.2 * random.standard_normal(len(t))
    for harmonic in (1, 2, 3):
        x += np.sin(2 * np.pi * 21 * harmonic * speed * t + harmonic) / harmonic
    x += 0.3 * np.sin(2 * np.pi * 3.58 * speed * t + 0.4)
    record = meshband.Record.from_arrays(x, rate, edges_s=np.arange(0.0, seconds, 1 / speed), teeth=(21, 64), title="own")
    path = tmp_path_factory.mktemp("loop") / "own"
    record.write(path)
    return path


def test_golden_kinematic_loop_gives_the_commands_json(folder, command, tmp_path):
    written = tmp_path / "loop.json"
    subprocess.run([command, "loop", folder, "--json", written], check=True, capture_output=True)
    found = meshband.Record.read(folder).loop()
    assert json.loads(written.read_text()) == found.to_dict()
    assert written.read_text() == found.to_json()


def test_fault_dynamic_level_says_everything_that_is_missing(folder):
    with pytest.raises(meshband.InvalidInput, match="model-based inference is not possible, missing"):
        meshband.Record.read(folder).loop(level="dynamic")
