"""The node's own chain on arrays."""

import numpy as np
import pytest

import meshband

RATE, SPEED, TEETH = 51_200.0, 20.0, (17, 38)


def signal(seconds: float) -> np.ndarray:
    t = np.arange(int(seconds * RATE)) / RATE
    return 3.0 * np.sin(2 * np.pi * TEETH[0] * SPEED * t) + np.sin(2 * np.pi * 2 * TEETH[0] * SPEED * t)


def test_replay_reports_mesh_lines_and_speed():
    seconds = 5.0
    record = meshband.Record.from_arrays(
        signal(seconds), RATE, edges_s=np.arange(0.0, seconds, 1 / (8 * SPEED)), pulses_per_turn=8, teeth=TEETH
    )
    said = meshband.replay(record)
    assert said.last("Status")["speed_hz"] == pytest.approx(SPEED, rel=1e-5)
    line = said.last("Spectrum")["bands"][0]["line"]
    assert line["frequency_hz"] == pytest.approx(TEETH[0] * SPEED, rel=1e-4)
    assert line["amplitude"] == pytest.approx(3.0, rel=0.01)
    assert len(said.link) > 1000 and said.of("Nothing") == []


def test_node_fed_block_by_block_locks_and_reports():
    node = meshband.Node(TEETH, pulses_per_turn=8, full_scale_m_s2=10.0)
    clock = node.ticks_per_second
    n, tick, messages = meshband.Node.BLOCK_SAMPLES, 0, []
    edges = np.rint(np.arange(1, 1000) / (8 * SPEED) * clock).astype(np.int64)
    while tick < 5.0 * clock:
        period = node.requested_period_ticks
        ticks = tick + period * np.arange(n)
        t = ticks / clock
        x = 3.0 * np.sin(2 * np.pi * TEETH[0] * SPEED * t)
        end = tick + period * n
        messages += node.feed(x, tick, period, edges[(edges >= tick) & (edges < end)])
        tick = end
    assert node.state == "Measuring"
    speeds = [m.fields["speed_hz"] for m in messages if m.kind == "Status"]
    assert speeds[-1] == pytest.approx(SPEED, rel=1e-4)


def test_fault_too_long_a_block_is_refused():
    node = meshband.Node(TEETH)
    with pytest.raises(meshband.InvalidInput, match="codes"):
        node.feed(np.zeros(meshband.Node.BLOCK_SAMPLES + 1), 0, 100)
    with pytest.raises(meshband.InvalidInput, match="configuration"):
        meshband.Node((0, 38))
