"""Records: arrays in and out, analysis, prediction, import, Ctrl-C."""

import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from scipy.signal import get_window

import meshband


@pytest.fixture(scope="module")
def simulated(machine):
    return machine.simulate(20.0, 10.0, duration_s=2.0, rate_hz=25_600.0, noise_m_s2=0.05, seed=3)


def test_golden_simulation_is_the_commands(simulated, command, root, tmp_path):
    folder = tmp_path / "record"
    options = "--speed 20 --torque 10 --duration 2 --rate 25600 --noise 0.05 --seed 3".split()
    subprocess.run([command, "simulate", root / "machines/17-38.toml", *options, "-o", folder], check=True, capture_output=True)
    of_command = meshband.Record.read(folder)
    np.testing.assert_array_equal(simulated.codes(), of_command.codes())
    np.testing.assert_allclose(simulated.edges_s(), of_command.edges_s(), atol=1e-9)


def test_record_comes_back_from_its_folder(simulated, tmp_path):
    again = simulated.write(tmp_path / "written")
    np.testing.assert_array_equal(again.codes(), simulated.codes())
    assert again.speed_hz() == pytest.approx(20.0, rel=1e-6)
    with pytest.raises(meshband.Error, match="written"):
        simulated.write(tmp_path / "written")


def test_ref_order_spectrum_shows_scipys_mesh_line(simulated):
    """The first mesh harmonic by a windowed transform made here."""
    found = simulated.analyse(channel=0)
    x = simulated.signal()
    window = get_window("flattop", len(x))
    spectrum = 2 * np.abs(np.fft.rfft(x * window)) / window.sum()
    frequency = np.fft.rfftfreq(len(x), 1 / simulated.sample_rate_hz)
    near = np.abs(frequency - 17 * 20.0) < 8
    harmonic = found["runs"][0]["channels"][0]["mesh"][0]
    amplitude = harmonic["line"]["amplitude"]
    assert amplitude == pytest.approx(spectrum[near].max(), rel=0.02)
    assert found.html.startswith("<!doctype html>") and "<iframe" in found._repr_html_()


def test_prediction_of_a_simulated_record_leaves_its_noise(simulated, tmp_path):
    record = simulated.write(tmp_path / "p")
    predicted = record.predict()[0]
    rest = record.signals()[2000:] - predicted[2000:]
    assert predicted.shape == record.signals().shape
    assert np.std(rest) < 0.1 < np.std(predicted)


def test_arrays_become_a_record_that_can_be_analysed():
    rate, speed = 25_600.0, 20.0
    t = np.arange(int(4 * rate)) / rate
    x = np.sin(2 * np.pi * 21 * speed * t) + 0.3 * np.sin(2 * np.pi * 3.58 * speed * t)
    x += 0.05 * np.random.default_rng(1).standard_normal(len(t))
    edges = np.arange(0.0, 4.0, 1 / speed)
    record = meshband.Record.from_arrays(x, rate, edges_s=edges, teeth=(21, 64))
    unexplained = record.analyse()["runs"][0]["channels"][0]["unexplained"]["spectrum"]
    # A bin is a 78th of an order.
    assert any(abs(family["base_order"] - 3.58) < 0.01 for family in unexplained)


def test_frames_carry_units(simulated):
    pytest.importorskip("pandas")
    frame = simulated.frame()
    assert frame.attrs["unit"] == "m/s2" and len(frame) == len(simulated.signals())


def test_import_of_a_wav_gives_its_samples(tmp_path):
    from scipy.io import wavfile

    rate = 12_800
    t = np.arange(4 * rate) / rate
    x = np.sin(2 * np.pi * 420.0 * t) + 0.01 * np.random.default_rng(2).standard_normal(len(t))
    wavfile.write(tmp_path / "x.wav", rate, x.astype(np.float32))
    record = meshband.import_files(tmp_path / "x.wav", teeth=(21, 64), mesh_hz=420.0, keep_float=True)
    np.testing.assert_allclose(record.signal(), x, atol=1e-6)
    assert record.speed_hz() == pytest.approx(20.0, rel=1e-4)
    assert record.summary["sample_rate_hz"] == rate
    with pytest.raises(meshband.InvalidInput, match="unit"):
        meshband.import_files(tmp_path / "x.wav", unit="furlong", no_tach=True)


def test_the_lock_is_released_during_work(machine):
    ticks = []
    stop = threading.Event()

    def count():
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.01)

    thread = threading.Thread(target=count)
    thread.start()
    machine.simulate(20.0, 10.0, duration_s=4.0, rate_hz=25_600.0)
    stop.set()
    thread.join()
    assert len(ticks) > 5


def test_fault_ctrl_c_ends_a_long_call(root):
    """A child is interrupted in the middle of minutes of work; it ends with KeyboardInterrupt."""
    code = (
        "import meshband, os, sys\n"
        f"machine = meshband.Machine.read({str(root / 'machines/17-38.toml')!r})\n"
        "print('begun', flush=True)\n"
        "try:\n"
        "    machine.simulate(20.0, 10.0, duration_s=400.0, rate_hz=51200.0)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', flush=True)\n"
        "    os._exit(7)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline().strip() == "begun"
    time.sleep(0.5)
    child.send_signal(signal.SIGINT)
    out, _ = child.communicate(timeout=60)
    assert out.strip() == "interrupted" and child.returncode == 7
