"""Measurement files written by the libraries that people use: the import must read what the library itself reads.

`MESHBAND_COMMAND` names the command where it is not the built one. Values are compared after rounding to float32, the
record's own precision, and in no other way. A record keeps no date; a start is seen where a second signal begins at
another time (`start_s`).
"""

import os
import subprocess
import tomllib
from datetime import datetime, timezone
from pathlib import Path
from types import SimpleNamespace

import asammdf
import h5py
import lvm_read
import mat73
import nptdms
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import pyuff
import scipy.io
import scipy.io.wavfile
import soundfile
from pyarrow import feather, parquet

ROOT = Path(__file__).resolve().parents[3]
RATE = 12_800
COUNT = 2_000
G = 9.80665
TIME = np.arange(COUNT) / RATE


def run(path, *options):
    """Imports one file into a folder beside it: the finished process and the folder."""
    command = Path(os.environ.get("MESHBAND_COMMAND", ROOT / "target" / "release" / "meshband"))
    assert command.is_file(), "build the command `meshband`, or say where it is by MESHBAND_COMMAND"
    folder = Path(path).parent / "record"
    arguments = [command, "import", path, "-o", folder, "--force", "--float", "--no-tach", "--no-gears", *options]
    return subprocess.run([str(x) for x in arguments], capture_output=True, text=True, timeout=60), folder


def imported(path, *options):
    """What the record of an imported file holds: rate, unit, names, channels, and the signals beside by name."""
    done, folder = run(path, *options)
    assert done.returncode == 0, done.stderr
    declared = tomllib.loads((folder / "record.toml").read_text())
    head, (only,) = declared["acquisition"], declared["run"]
    values = np.load(folder / only["signal"])
    assert values.dtype == np.float32
    beside = {
        each["name"]: SimpleNamespace(
            values=np.load(folder / each["file"]).ravel(),
            unit=each["unit"],
            rate=each.get("sample_rate_hz"),
            start=each.get("start_s", 0.0),
        )
        for each in only.get("beside", [])
    }
    unit = head.get("unit", "m/s2")
    return SimpleNamespace(
        rate=head["sample_rate_hz"], unit=unit, names=head["channels"], values=values, beside=beside, said=done.stdout
    )


def same(found, names, values, rate=RATE, unit="unknown", factor=1.0, in_float32=False):
    """Asserts names, values (one array per channel), rate and unit; `factor` leads from the file's unit to it.

    `in_float32`: the library calculates in float32 itself and may be off by its last bit.
    """
    assert found.names == list(names)
    assert found.unit == unit
    assert found.rate == pytest.approx(rate, rel=1e-9)
    expected = np.stack([factor * np.asarray(x, float).ravel() for x in values], axis=1)
    atol = np.finfo(np.float32).eps * np.abs(expected).max() if in_float32 else 0.0
    np.testing.assert_allclose(found.values.reshape(len(expected), -1), expected.astype(np.float32), rtol=0, atol=atol)


def beside(found, name, values, unit, start=0.0, rate=RATE):
    """Asserts a signal beside the channels: values, unit, rate, and its start after theirs."""
    signal = found.beside[name]
    assert signal.unit == unit and signal.rate == pytest.approx(rate, rel=1e-9)
    assert signal.start == pytest.approx(start, abs=1e-9)
    np.testing.assert_array_equal(signal.values, np.asarray(values, float).astype(np.float32))


def refused(path, word, without="panicked"):
    """Asserts a refusal in one line that names the file, with one word and without another."""
    done, _ = run(path, "--rate", RATE)
    message = done.stderr.strip()
    assert done.returncode == 2 and "\n" not in message and Path(path).name in message, done
    assert word in message.lower() and without not in message, message


def noise(seed, dtype="f8", shape=COUNT):
    """Noise that a type can hold: over the whole range of short integers, with all digits of floats."""
    random, dtype = np.random.default_rng(seed), np.dtype(dtype)
    if dtype.kind == "f":
        return random.standard_normal(shape).astype(dtype)
    held = np.iinfo(dtype)
    return random.integers(max(held.min, -(2**40)), min(held.max, 2**40), shape, endpoint=True).astype(dtype)


# MATLAB.

INTEGERS = ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"]


@pytest.mark.parametrize("oned_as", ["row", "column"])
@pytest.mark.parametrize(
    "version, compressed, dtype",
    [("4", False, dtype) for dtype in ["f8", "f4", "i4", "i2", "u2", "u1"]]
    + [("5", compressed, dtype) for compressed in [False, True] for dtype in ["f8", "f4", *INTEGERS]],
)
def test_mat_arrays(tmp_path, version, compressed, dtype, oned_as):
    """Vectors of every type that savemat writes, with the rate beside them."""
    path = tmp_path / "m.mat"
    arrays = {"A1": noise(1, dtype), "B": noise(2, dtype), "fs": float(RATE)}
    scipy.io.savemat(path, arrays, format=version, do_compression=compressed, oned_as=oned_as)
    own = scipy.io.loadmat(path)
    same(imported(path), ["m A1", "m B"], [own["A1"], own["B"]], own["fs"].item())


@pytest.mark.parametrize("version", ["4", "5"])
def test_mat_matrix(tmp_path, version):
    """A matrix of samples x channels."""
    scipy.io.savemat(tmp_path / "m.mat", {"X": noise(3, shape=(COUNT, 3)), "fs": float(RATE)}, format=version)
    own = scipy.io.loadmat(tmp_path / "m.mat")["X"]
    same(imported(tmp_path / "m.mat"), ["m X 0", "m X 1", "m X 2"], own.T)


@pytest.mark.parametrize("compressed", [False, True])
def test_mat_structure(tmp_path, compressed):
    """A structure with rate and unit, among texts, cells, complex and empty arrays."""
    inner = {"gs": noise(4), "sr": RATE, "unit": "g", "load": 270.0, "title": "a bearing"}
    others = {"note": "text", "empty": np.zeros((0, 0)), "z": 1j * noise(5), "cell": np.array([1.0, "a"], object)}
    scipy.io.savemat(tmp_path / "m.mat", {"bearing": inner, **others}, do_compression=compressed)
    own = scipy.io.loadmat(tmp_path / "m.mat", simplify_cells=True)["bearing"]
    same(imported(tmp_path / "m.mat"), ["m bearing.gs"], [own["gs"]], own["sr"], "m/s2", G)


def matlab_73(path, arrays):
    """Writes arrays as MATLAB 7.3 does: turned, with their class, behind a user block."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, (array, kind, extra) in arrays.items():
            file.create_dataset(name, data=array.T, **extra).attrs["MATLAB_class"] = np.bytes_(kind)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM")


@pytest.mark.parametrize("extra", [{}, {"chunks": (1, 500), "compression": "gzip", "shuffle": True}])
@pytest.mark.parametrize("kind, dtype", [("double", "f8"), ("single", "f4"), ("int16", "i2"), ("uint8", "u1")])
def test_mat73(tmp_path, kind, dtype, extra):
    """MATLAB 7.3 as mat73 reads it: a column, a matrix, and the rate."""
    x, y = noise(6, dtype, (COUNT, 1)), noise(7, dtype, (COUNT, 2))
    rate = (np.array([[RATE]], float), "double", {})
    matlab_73(tmp_path / "m.mat", {"A": (x, kind, extra), "B": (y, kind, extra), "fs": rate})
    own = mat73.loadmat(tmp_path / "m.mat")
    assert own["A"].shape == (COUNT,) and own["B"].shape == (COUNT, 2)
    same(imported(tmp_path / "m.mat"), ["m A", "m B 0", "m B 1"], [own["A"], *own["B"].T], own["fs"].item())


# HDF5.

STORAGES = {
    "contiguous": {},
    "chunked": {"chunks": (300,)},
    "gzip": {"chunks": (300,), "compression": "gzip"},
    "gzip9": {"chunks": (300,), "compression": "gzip", "compression_opts": 9},
    "shuffle": {"chunks": (300,), "compression": "gzip", "shuffle": True},
    "fletcher32": {"chunks": (300,), "fletcher32": True},
    "all": {"chunks": (300,), "compression": "gzip", "shuffle": True, "fletcher32": True},
    "scaleoffset": {"chunks": (300,), "scaleoffset": 4},
    "growing": {"maxshape": (None,)},
}


@pytest.mark.parametrize("libver", ["earliest", "latest"])
@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8", ">f8", "<i2", ">i2"])
@pytest.mark.parametrize("storage", STORAGES)
def test_hdf5_storage(tmp_path, storage, dtype, libver):
    """Every storage of h5py, rate and unit as attributes of the array."""
    with h5py.File(tmp_path / "h.h5", "w", libver=libver) as file:
        array = file.create_dataset("A1", data=noise(8, dtype), dtype=dtype, **STORAGES[storage])
        array.attrs.update({"sample_rate": RATE, "unit": "g"})
    with h5py.File(tmp_path / "h.h5") as file:
        own, rate = file["A1"][:], file["A1"].attrs["sample_rate"]
    same(imported(tmp_path / "h.h5"), ["h A1"], [own], rate, "m/s2", G)


@pytest.mark.parametrize("extra", [{}, {"chunks": (300, 2), "compression": "gzip"}])
@pytest.mark.parametrize("dtype", ["f4", "f8", *INTEGERS])
def test_hdf5_matrix_of_a_group(tmp_path, dtype, extra):
    """An array of samples x channels whose group states rate and unit."""
    with h5py.File(tmp_path / "h.h5", "w") as file:
        group = file.create_group("run")
        group.attrs.update({"fs": float(RATE), "units": "m/s^2"})
        group.create_dataset("X", data=noise(9, dtype, (COUNT, 3)), **extra)
    with h5py.File(tmp_path / "h.h5") as file:
        own, rate = file["run/X"][:], file["run"].attrs["fs"]
    same(imported(tmp_path / "h.h5"), ["h run/X 0", "h run/X 1", "h run/X 2"], own.T, rate, "m/s2")


@pytest.mark.parametrize("text", ["variable", "fixed", "array"])
@pytest.mark.parametrize("number", [float, np.float32, np.int32, lambda x: np.array([x])])
def test_hdf5_attributes(tmp_path, number, text):
    """Scale and offset of integers; attributes as h5py and other writers store them, single or arrays of one."""
    unit = {"variable": "m/s2", "fixed": np.bytes_("m/s2"), "array": np.array(["m/s2"], h5py.string_dtype())}[text]
    with h5py.File(tmp_path / "h.h5", "w") as file:
        array = file.create_dataset("A1", data=noise(10, "i2"))
        array.attrs.update({"scale_factor": 0.00125, "add_offset": -3.5, "fs": number(RATE), "units": unit})
    with h5py.File(tmp_path / "h.h5") as file:
        own = file["A1"][:] * file["A1"].attrs["scale_factor"] + file["A1"].attrs["add_offset"]
    same(imported(tmp_path / "h.h5"), ["h A1"], [own], RATE, "m/s2")


def test_hdf5_lzf_is_refused(tmp_path):
    """A compression of h5py alone: called by its name, and the file not called broken."""
    with h5py.File(tmp_path / "h.h5", "w") as file:
        file.create_dataset("A1", data=np.arange(COUNT) // 10, compression="lzf")
    refused(tmp_path / "h.h5", "lzf", without="broken")


@pytest.mark.parametrize("storage", ["virtual", "external"])
def test_hdf5_in_other_files_is_refused(tmp_path, storage):
    """Values that lie in another file: said so, and the file not called broken."""
    with h5py.File(tmp_path / "h.h5", "w") as file:
        if storage == "external":
            file.create_dataset("A1", (COUNT,), "f8", external=[("raw.bin", 0, h5py.h5f.UNLIMITED)])[:] = noise(11)
        else:
            layout = h5py.VirtualLayout((COUNT,), "f8")
            layout[:] = h5py.VirtualSource("other.h5", "A1", (COUNT,))
            file.create_virtual_dataset("A1", layout)
    refused(tmp_path / "h.h5", storage, without="broken")


def test_hdf5_half_precision(tmp_path):
    """float16: read, and with what is not read never passed over as no number."""
    with h5py.File(tmp_path / "h.h5", "w") as file:
        file.create_dataset("A1", data=noise(11, "f2"))
        file.attrs["fs"] = RATE
    with h5py.File(tmp_path / "h.h5") as file:
        own = file["A1"][:]
    same(imported(tmp_path / "h.h5"), ["h A1"], [own])


def test_hdf5_starts(tmp_path):
    """Arrays that start at different times."""
    with h5py.File(tmp_path / "h.h5", "w") as file:
        for name, unit, start in [("A1", "m/s2", 1.5), ("M", "N m", 1.75)]:
            file[name] = noise(11)
            file[name].attrs.update({"dt": 1 / RATE, "unit": unit, "t0": start})
    with h5py.File(tmp_path / "h.h5") as file:
        a, m, later = file["A1"][:], file["M"][:], file["M"].attrs["t0"] - file["A1"].attrs["t0"]
    found = imported(tmp_path / "h.h5")
    same(found, ["h A1"], [a], unit="m/s2")
    beside(found, "h M", m, "N m", later)


# Sound files.


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("dtype", ["u1", "i2", "i4", "i8", "f4", "f8"])
def test_wav_of_scipy(tmp_path, dtype, channels):
    """Every type that scipy writes; integers over full scale."""
    scipy.io.wavfile.write(tmp_path / "w.wav", RATE, noise(12, dtype, (COUNT, channels)))
    rate, own = scipy.io.wavfile.read(tmp_path / "w.wav")
    own = own.reshape(COUNT, channels)
    if own.dtype.kind != "f":
        own = (own.astype(float) - (128 if dtype == "u1" else 0)) / 2.0 ** (8 * own.itemsize - 1)
    same(imported(tmp_path / "w.wav"), ["w"] if channels == 1 else ["w 0", "w 1"], own.T, rate)


SOUNDS = [(kind, sub) for kind in ["WAV", "WAVEX", "RF64"] for sub in ["PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT"]]
SOUNDS += [("WAV", "DOUBLE"), ("RF64", "DOUBLE"), ("FLAC", "PCM_S8"), ("FLAC", "PCM_16"), ("FLAC", "PCM_24")]


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("kind, subtype", SOUNDS)
def test_sound_of_libsndfile(tmp_path, kind, subtype, channels):
    """WAV, extensible WAV, RF64 and FLAC of every depth, mono and three channels."""
    path = tmp_path / f"s.{'flac' if kind == 'FLAC' else 'wav'}"
    soundfile.write(path, 0.3 * noise(13, shape=(COUNT, channels)), RATE, subtype, format=kind)
    own, rate = soundfile.read(path, always_2d=True)
    same(imported(path), ["s"] if channels == 1 else ["s 0", "s 1", "s 2"], own.T, rate)


@pytest.mark.parametrize("endian", ["BIG", "LITTLE"])
@pytest.mark.parametrize("subtype", ["PCM_16", "PCM_24", "FLOAT"])
def test_wav_of_both_byte_orders(tmp_path, subtype, endian):
    """RIFX, too."""
    soundfile.write(tmp_path / "s.wav", 0.3 * noise(14, shape=(COUNT, 2)), RATE, subtype, endian, "WAV")
    own, rate = soundfile.read(tmp_path / "s.wav")
    same(imported(tmp_path / "s.wav"), ["s 0", "s 1"], own.T, rate)


@pytest.mark.parametrize(
    "kind, subtype, word",
    [("W64", "PCM_16", "w64"), ("AIFF", "PCM_16", "aiff"), ("WAV", "ULAW", "mu-law"), ("WAV", "IMA_ADPCM", "adpcm")],
)
def test_sound_that_is_refused(tmp_path, kind, subtype, word):
    """Sound that is not read is called by its name."""
    path = tmp_path / f"s.{kind.lower()}"
    soundfile.write(path, 0.3 * noise(15), RATE, subtype, format=kind)
    refused(path, word)


# NumPy and text.


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", "<f8 >f8 <f4 >f4 i1 u1 <i2 >i2 <u2 >u2 <i4 >i4 <i8 >i8".split())
def test_npy(tmp_path, dtype, order):
    """Both orders, both byte orders, integers."""
    np.save(tmp_path / "n.npy", np.asarray(noise(16, dtype, (COUNT, 2)), order=order))
    own = np.load(tmp_path / "n.npy")
    assert own.flags.f_contiguous == (order == "F")
    same(imported(tmp_path / "n.npy", "--rate", RATE), ["n-0", "n-1"], own.T)


@pytest.mark.parametrize("shape", [(COUNT,), (COUNT, 1), (1, COUNT), (3, COUNT)])
def test_npy_shapes(tmp_path, shape):
    """One dimension, one column, one row, and channels x samples."""
    np.save(tmp_path / "n.npy", noise(16, shape=shape))
    own = np.load(tmp_path / "n.npy").T.reshape(COUNT, -1)
    same(imported(tmp_path / "n.npy", "--rate", RATE), [f"n-{c}" for c in range(own.shape[1])], own.T)


@pytest.mark.parametrize("form", ["%.18e", "%.9g", "%f"])
def test_savetxt(tmp_path, form):
    """numpy.savetxt as it writes by itself, without names."""
    np.savetxt(tmp_path / "t.txt", noise(17, shape=(COUNT, 2)), fmt=form)
    found = imported(tmp_path / "t.txt", "--rate", RATE)
    same(found, found.names, np.loadtxt(tmp_path / "t.txt").T)


@pytest.mark.parametrize("comments", ["# ", ""])
@pytest.mark.parametrize("sign", [",", ";", "\t"])
def test_savetxt_with_header(tmp_path, sign, comments):
    """A csv with a time column, names and units."""
    table = np.column_stack([TIME, noise(18, shape=(COUNT, 2))])
    header = sign.join(["Time [s]", "A1 [g]", "A2 [g]"])
    np.savetxt(tmp_path / "t.csv", table, delimiter=sign, header=header, comments=comments)
    own = np.loadtxt(tmp_path / "t.csv", delimiter=sign, skiprows=1)
    same(imported(tmp_path / "t.csv"), ["A1", "A2"], own[:, 1:].T, 1 / np.diff(own[:, 0]).mean(), "m/s2", G)


@pytest.mark.parametrize("compression", [None, "gzip"])
@pytest.mark.parametrize("index", [False, True])
@pytest.mark.parametrize("sep, decimal", [(",", "."), (";", ","), (";", "."), ("\t", ",")])
def test_pandas_csv(tmp_path, sep, decimal, index, compression):
    """Frames with and without the row index, decimal point and comma, compressed."""
    path, how = tmp_path / ("p.csv.gz" if compression else "p.csv"), {"sep": sep, "decimal": decimal}
    frame = pd.DataFrame({"time": TIME, "A1": noise(19), "A2": noise(20, "i2")})
    frame.to_csv(path, index=index, compression=compression, **how)
    own = pd.read_csv(path, **how)
    same(imported(path, "--time-unit", "s"), ["A1", "A2"], [own["A1"], own["A2"]], 1 / own["time"].diff().mean())


@pytest.mark.parametrize("label", [None, "time", "timestamp"])
@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
@pytest.mark.parametrize("start", ["2024-03-05 12:00:00", "2024-10-27 00:59:59.9"])
def test_pandas_csv_with_a_datetime_index(tmp_path, start, zone, label):
    """Dates in the index, to the microsecond, with and without a zone, over the end of summer time."""
    index = pd.date_range(start, periods=COUNT, freq="100us", tz="UTC", name=label).tz_convert(zone)
    pd.DataFrame({"A1": noise(21), "A2": noise(22)}, index=index).to_csv(tmp_path / "p.csv")
    own = pd.read_csv(tmp_path / "p.csv", index_col=0)
    steps = pd.to_datetime(own.index, utc=True).diff()
    same(imported(tmp_path / "p.csv"), ["A1", "A2"], [own["A1"], own["A2"]], 1 / steps.mean().total_seconds())


# Universal files.


def uff58(path, sets, binary, kind):
    """Writes datasets 58 (name, unit, first time, values) of single (2) or double (4) precision; as pyuff reads them.

    Always by adding: pyuff 2.5.8 loses the head of a binary set that overwrites. Its binary numbers are always
    doubles, whatever the head says; those of single precision are put in their place here.
    """
    file = pyuff.UFF(str(path))
    for name, unit, start, values in sets:
        quantity = {"ordinate_spec_data_type": 12, "ordinate_axis_units_lab": unit, "ord_data_type": kind}
        axis = {"abscissa_spec_data_type": 17, "abscissa_axis_units_lab": "s", "abscissa_min": start}
        time = {"abscissa_inc": 1 / RATE, "abscissa_spacing": 1, "x": start + TIME}
        head = {"type": 58, "func_type": 1, "binary": binary, "id1": name, "orddenom_spec_data_type": 0}
        nodes = {"rsp_node": 0, "rsp_dir": 0, "ref_node": 0, "ref_dir": 0}
        data = {"num_pts": len(values), "data": values}
        file.write_sets({**head, **nodes, **quantity, **axis, **time, **data}, "add", force_double=kind == 4)
        if kind == 2 and binary:
            path.write_bytes(path.read_bytes().replace(values.astype("<f8").tobytes(), values.astype("<f4").tobytes()))
    own = pyuff.UFF(str(path)).read_sets()
    assert len(own) == len(sets) and all(each["ord_data_type"] == kind for each in own)
    return own


@pytest.mark.parametrize("kind", [2, 4])
@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("unit, factor", [("g", G), ("m/s^2", 1.0)])
@pytest.mark.parametrize("count", [COUNT, COUNT - 3])
def test_uff58(tmp_path, binary, kind, unit, factor, count):
    """Two channels in text and binary, single and double precision, also with a last line that is not full."""
    sets = [(name, unit, 0.0, noise(seed)[:count]) for name, seed in [("Housing X", 23), ("Housing Y", 24)]]
    own = uff58(tmp_path / "u.uff", sets, binary, kind)
    names, values = [each["id1"].strip() for each in own], [each["data"] for each in own]
    assert own[0]["ordinate_axis_units_lab"] == unit and len(values[0]) == count
    same(imported(tmp_path / "u.uff"), names, values, 1 / own[0]["abscissa_inc"], "m/s2", factor)


@pytest.mark.parametrize("binary", [0, 1])
def test_uff58_starts(tmp_path, binary):
    """Datasets that start at different times."""
    sets = [("A", "m/s2", 0.5, noise(25)), ("M", "N m", 0.75, noise(26))]
    a, m = uff58(tmp_path / "u.uff", sets, binary, 4)
    found = imported(tmp_path / "u.uff")
    same(found, ["A"], [a["data"]], unit="m/s2")
    beside(found, "M", m["data"], m["ordinate_axis_units_lab"], m["abscissa_min"] - a["abscissa_min"])


# TDMS.


def tdms(path, channels, segments=1, group=None, root=None):
    """Writes channels (name, values, properties) in segments; every channel as npTDMS reads it."""
    with nptdms.TdmsWriter(path) as writer:
        for part in range(segments):
            objects = [nptdms.RootObject(root or {}), nptdms.GroupObject("run", group or {})]
            for name, values, properties in channels:
                objects.append(nptdms.ChannelObject("run", name, np.array_split(values, segments)[part], properties))
            writer.write_segment(objects if part == 0 else objects[2:])
    own = nptdms.TdmsFile.read(path)["run"]
    return {name: own[name] for name, _, _ in channels}


@pytest.mark.parametrize("segments", [1, 3])
@pytest.mark.parametrize("dtype", ["f4", "f8", *INTEGERS])
def test_tdms(tmp_path, dtype, segments):
    """Every type in one segment and in several."""
    head = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0, "unit_string": "g"}
    channels = [("A1", noise(27, dtype), head), ("B'2", noise(28, dtype), head)]
    own = tdms(tmp_path / "t.tdms", channels, segments)
    increment = own["A1"].properties["wf_increment"]
    same(imported(tmp_path / "t.tdms"), own, [own[name][:] for name in own], 1 / increment, "m/s2", G)


@pytest.mark.parametrize("unit", ["g", "m/s^2", "V", "mV", "Pa"])
def test_tdms_units(tmp_path, unit):
    """Units of the channel, the rate at the group."""
    own = tdms(tmp_path / "t.tdms", [("A1", noise(29), {"unit_string": unit})], group={"wf_increment": 1 / RATE})
    symbol, factor = {"g": ("m/s2", G), "m/s^2": ("m/s2", 1.0), "mV": ("V", 1e-3)}.get(unit, (unit, 1.0))
    same(imported(tmp_path / "t.tdms"), ["A1"], [own["A1"][:]], RATE, symbol, factor)


def test_tdms_starts(tmp_path):
    """Channels that start at different times, by offset and by date."""
    date = np.datetime64("2024-03-05T12:00:00.000000")
    head = {"wf_increment": 1 / RATE, "wf_start_time": date, "wf_start_offset": 0.5, "unit_string": "g"}
    by_offset = {**head, "wf_start_offset": 0.75, "unit_string": "Nm"}
    by_date = {**by_offset, "wf_start_offset": 0.5, "wf_start_time": date + np.timedelta64(125, "ms")}
    channels = [("A", noise(30), head), ("M", noise(31), by_offset), ("N", noise(32), by_date)]
    own = tdms(tmp_path / "t.tdms", channels)
    first = own["A"].time_track(absolute_time=True, accuracy="us")[0]
    found = imported(tmp_path / "t.tdms")
    same(found, ["A"], [own["A"][:]], unit="m/s2", factor=G)
    for name in ["M", "N"]:
        later = own[name].time_track(absolute_time=True, accuracy="us")[0] - first
        beside(found, name, own[name][:], "N m", later / np.timedelta64(1, "s"))


LINEAR = {"Scale_Type": "Linear", "Linear_Slope": 0.00125, "Linear_Y_Intercept": 0.5, "Linear_Input_Source": 0xFFFFFFFF}
CURVE = {"Scale_Type": "Polynomial", "Polynomial_Coefficients_Size": 3, "Polynomial_Input_Source": 0}
CURVE |= {f"Polynomial_Coefficients[{k}]": value for k, value in enumerate([0.25, 2.0, 0.125])}
TABLE = {"Scale_Type": "Table", "Table_Input_Source": 0}
TABLE |= {"Table_Scaled_Values_Size": 3, "Table_Pre_Scaled_Values_Size": 3}
TABLE |= {f"Table_Scaled_Values[{k}]": value for k, value in enumerate([-50.0, 0.0, 50.0])}
TABLE |= {f"Table_Pre_Scaled_Values[{k}]": value for k, value in enumerate([-60.0, 1.0, 90.0])}


def scales(*several):
    """The properties of a chain of scales."""
    flat = {f"NI_Scale[{k}]_{key}": value for k, own in enumerate(several) for key, value in own.items()}
    return {"NI_Scaling_Status": "unscaled", "NI_Number_Of_Scales": len(several), **flat}


@pytest.mark.parametrize("at", ["channel", "group", "file"])
@pytest.mark.parametrize("chain", [(LINEAR,), (LINEAR, CURVE), (LINEAR, TABLE)])
@pytest.mark.parametrize("dtype", ["i2", "i4", "f4", "f8"])
def test_tdms_scales(tmp_path, dtype, chain, at):
    """Scaled values, the scales of the channel, its group or the file."""
    said = scales(*chain)
    head = {"wf_increment": 1 / RATE, "unit_string": "g", **(said if at == "channel" else {})}
    raw = noise(33, dtype) if dtype[0] == "f" else noise(33, "i2").astype(dtype)
    places = {"group": said if at == "group" else {}, "root": said if at == "file" else {}}
    own = tdms(tmp_path / "t.tdms", [("A1", raw, head)], **places)["A1"]
    assert not np.array_equal(own[:], own.read_data(scaled=False))
    same(imported(tmp_path / "t.tdms"), ["A1"], [own[:]], RATE, "m/s2", G, in_float32=dtype == "f4")


# LabVIEW text.


def lvm(path, x_columns="One", separator="\t", comma=False, segments=1, comment=False, offset=0.0):
    """Writes the form of lvm_read's sample files, two accelerations and a torque; what lvm_read reads."""
    number = (lambda x: f"{x:.9g}".replace(".", ",")) if comma else (lambda x: f"{x:.9g}")
    head = [["LabVIEW Measurement", ""], ["Writer_Version", "2"], ["Reader_Version", "2"]]
    head += [["Separator", "Comma" if separator == "," else "Tab"], ["Decimal_Separator", "," if comma else "."]]
    head += [["Multi_Headings", "Yes"], ["X_Columns", x_columns], ["Time_Pref", "Relative"], ["Operator", "me"]]
    head += [["Date", "2024/03/05"], ["Time", "12:00:00"], ["***End_of_Header***", ""], [""]]
    wide = (lambda cells: [x for cell in cells for x in (cell, "")][:-1]) if x_columns == "Multi" else list
    rows, samples, multi = head, noise(34, shape=(COUNT, 3)), x_columns == "Multi"
    for part in np.array_split(np.arange(COUNT), segments):
        starts = [part[0] / RATE, part[0] / RATE, part[0] / RATE + offset]
        rows += [["Channels", "3", *[""] * (5 if multi else 2)], ["Samples", *wide([str(len(part))] * 3)]]
        rows += [["Date", *wide(["2024/03/05"] * 3)], ["Time", *wide(["12:00:00"] * 3)]]
        rows += [["Y_Unit_Label", *wide(["g", "g", "N*m"])], ["X_Dimension", *wide(["Time"] * 3)]]
        rows += [["X0", *wide(map(number, starts))], ["Delta_X", *wide([number(1 / RATE)] * 3)]]
        rows.append(["***End_of_Header***", ""])
        names = ["A1", "A2", "M"]
        rows.append([x for name in names for x in ("X_Value", name)] if multi else ["X_Value", *names])
        rows[-1] += ["Comment"] if comment else []
        for row in part:
            time = "" if x_columns == "No" else number(row / RATE)
            cells = [number(x) for x in samples[row]]
            rows.append([x for cell in cells for x in (time, cell)] if multi else [time, *cells])
        rows.append([""])
    rows.pop()
    path.write_text("".join(separator.join(row) + "\n" for row in rows))
    return lvm_read.read(str(path), read_from_pickle=False, dump_file=False)


@pytest.mark.parametrize("x_columns", ["One", "No", "Multi"])
@pytest.mark.parametrize("separator, comma", [("\t", False), ("\t", True), (",", False)])
@pytest.mark.parametrize("segments", [1, 3])
@pytest.mark.parametrize("comment", [False, True])
def test_lvm(tmp_path, x_columns, separator, comma, segments, comment):
    """With and without a time column, decimal point and comma, one segment and several, with comments."""
    own = lvm(tmp_path / "l.lvm", x_columns, separator, comma, segments, comment, offset=0.25)
    assert own["Segments"] == segments
    names = [name for name in own[0]["Channel names"] if name not in ["X_Value", "Comment"]]
    places = [own[0]["Channel names"].index(name) for name in names]
    parts = [own[k]["data"][:, places] for k in range(segments)]
    values = np.concatenate(parts).T
    assert values.shape == (3, COUNT) and not np.isnan(values).any()
    found = imported(tmp_path / "l.lvm")
    same(found, names[:2], values[:2], 1 / own[0]["Delta_X"][0], "m/s2", G)
    beside(found, names[2], values[2], "N m", own[0]["X0"][4 if x_columns == "Multi" else 2] - own[0]["X0"][0])


# ---------------------------------------------------------------------------------------------------------------------
# MDF 4, Parquet and Feather: these readers are being written; until then every test below fails.
# ---------------------------------------------------------------------------------------------------------------------

DATE = datetime(2024, 3, 5, 12, 0, 0, tzinfo=timezone.utc)


def mdf(path, groups, version="4.10", compression=0):
    """Writes groups (times, {name: (values, unit, conversion)}); every signal as asammdf reads it."""
    with asammdf.MDF(version=version) as file:
        file.start_time = DATE
        for times, signals in groups:
            several = [
                asammdf.Signal(samples=values, timestamps=times, name=name, unit=unit, conversion=conversion)
                for name, (values, unit, conversion) in signals.items()
            ]
            file.append(several, common_timebase=True)
        file.save(path, overwrite=True, compression=compression)
    with asammdf.MDF(path) as file:
        return {name: file.get(name) for _, signals in groups for name in signals}


def rate_of(signal):
    """The rate by the master channel."""
    return (len(signal.timestamps) - 1) / (signal.timestamps[-1] - signal.timestamps[0])


@pytest.mark.parametrize("compression", [0, 1, 2])
@pytest.mark.parametrize(
    "version, dtype",
    [("4.10", dtype) for dtype in ["f4", "f8", ">f4", ">i2", *INTEGERS]]
    + [(version, "f8") for version in ["4.00", "4.11", "4.20"]],
)
def test_mf4(tmp_path, dtype, version, compression):
    """Every type, plain, deflated, and transposed and deflated."""
    signals = {"A1": (noise(35, dtype), "g", None), "A2": (noise(36, dtype), "g", None)}
    own = mdf(tmp_path / "m.mf4", [(TIME, signals)], version, compression)
    values = [signal.samples for signal in own.values()]
    same(imported(tmp_path / "m.mf4"), own, values, rate_of(own["A1"]), "m/s2", G)


@pytest.mark.parametrize("unit", ["g", "m/s^2", "V", "Pa", ""])
def test_mf4_units(tmp_path, unit):
    """Units of the channels."""
    own = mdf(tmp_path / "m.mf4", [(TIME, {"A1": (noise(37), unit, None)})])["A1"]
    symbol, factor = {"g": ("m/s2", G), "m/s^2": ("m/s2", 1.0), "": ("unknown", 1.0)}.get(own.unit, (own.unit, 1.0))
    same(imported(tmp_path / "m.mf4"), ["A1"], [own.samples], RATE, symbol, factor)


MDF_TABLE = {f"raw_{k}": raw for k, raw in enumerate([-2e4, 0.0, 2e4])}
MDF_TABLE |= {f"phys_{k}": value for k, value in enumerate([-50.0, 1.0, 60.0])}


@pytest.mark.parametrize("compression", [0, 2])
@pytest.mark.parametrize(
    "conversion", [{"a": 0.00125, "b": -3.5}, {**MDF_TABLE, "interpolation": True}]
)
@pytest.mark.parametrize("dtype", ["i2", "u2", "i4"])
def test_mf4_conversions(tmp_path, dtype, conversion, compression):
    """Physical values by a line or a table with interpolation; raw values are never taken for them."""
    signals = {"A1": (noise(38, "i2").astype(dtype), "m/s^2", dict(conversion))}
    own = mdf(tmp_path / "m.mf4", [(TIME, signals)], compression=compression)["A1"]
    assert not np.array_equal(own.samples, signals["A1"][0])
    same(imported(tmp_path / "m.mf4"), ["A1"], [own.samples], RATE, "m/s2")


def test_mf4_formula_is_refused(tmp_path):
    """A formula is not calculated: its raw values are no channel."""
    mdf(tmp_path / "m.mf4", [(TIME, {"A1": (noise(38, "i2"), "m/s^2", {"formula": "X1 * 0.5 + 2"})})])
    refused(tmp_path / "m.mf4", "formulas")


def test_mf4_groups(tmp_path):
    """Groups of other rates and starts."""
    slow = 0.5 + np.arange(100) / 640
    groups = [(0.25 + TIME, {"A1": (noise(39), "g", None)}), (slow, {"M": (noise(40, shape=100), "Nm", None)})]
    own = mdf(tmp_path / "m.mf4", groups)
    found = imported(tmp_path / "m.mf4")
    same(found, ["A1"], [own["A1"].samples], rate_of(own["A1"]), "m/s2", G)
    later = own["M"].timestamps[0] - own["A1"].timestamps[0]
    beside(found, "M", own["M"].samples, "N m", later, rate_of(own["M"]))


def table(dtype, time, units, rate=None):
    """An Arrow table: time if it is named, two channels, units in the fields' metadata, a rate in the schema's."""
    columns = {} if time is None else {time: TIME}
    columns |= {"A1": noise(41, dtype), "A2": noise(42, dtype)}
    fields = [
        pa.field(name, pa.from_numpy_dtype(values.dtype), metadata={"unit": units} if units and name != time else None)
        for name, values in columns.items()
    ]
    said = {"sample_rate_hz": str(rate)} if rate else None
    return pa.table(list(columns.values()), schema=pa.schema(fields, metadata=said))


def columns_of(own):
    """Channels of a table as the library reads it."""
    return [own["A1"].to_numpy(), own["A2"].to_numpy()]


PACKED = ["none", "snappy", "gzip", "zstd", "lz4", "brotli"]
PARQUET_FORMS = [{}, {"data_page_version": "2.0"}, {"use_dictionary": False}, {"row_group_size": 300}]


@pytest.mark.parametrize(
    "dtype, form, compression",
    [(dtype, {}, "snappy") for dtype in ["f4", *INTEGERS]]
    + [("f8", form, packed) for form in PARQUET_FORMS for packed in PACKED],
)
def test_parquet(tmp_path, dtype, form, compression):
    """Every type, compression, page and row group."""
    parquet.write_table(table(dtype, "time", "g"), tmp_path / "p.parquet", compression=compression, **form)
    own = parquet.read_table(tmp_path / "p.parquet")
    unit = own.schema.field("A1").metadata[b"unit"].decode()
    assert unit == "g"
    rate = 1 / np.diff(own["time"].to_numpy()).mean()
    same(imported(tmp_path / "p.parquet", "--time-unit", "s"), ["A1", "A2"], columns_of(own), rate, "m/s2", G)


@pytest.mark.parametrize("encoding", ["PLAIN", "BYTE_STREAM_SPLIT", "DELTA_BINARY_PACKED"])
def test_parquet_encodings(tmp_path, encoding):
    """Encodings beside the usual one."""
    dtype = "i4" if encoding.startswith("DELTA") else "f4"
    form = {"use_dictionary": False, "column_encoding": {"A1": encoding, "A2": encoding}}
    parquet.write_table(table(dtype, None, "m/s2", RATE), tmp_path / "p.parquet", **form)
    own = parquet.read_table(tmp_path / "p.parquet")
    rate = float(own.schema.metadata[b"sample_rate_hz"])
    same(imported(tmp_path / "p.parquet"), ["A1", "A2"], columns_of(own), rate, "m/s2")


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("ending", ["parquet", "feather"])
def test_arrow_stamps(tmp_path, ending, unit):
    """Stamps of every unit as pandas' index; the rate by their distance."""
    step = {"s": 1.0, "ms": 0.01, "us": 1e-4, "ns": 1e-4}[unit]
    index = pd.date_range(DATE, periods=COUNT, freq=pd.Timedelta(step, "s"), name="time").as_unit(unit)
    frame = pd.DataFrame({"A1 [g]": noise(43), "A2 [g]": noise(44)}, index=index)
    path = tmp_path / f"p.{ending}"
    frame.to_parquet(path) if ending == "parquet" else frame.reset_index().to_feather(path)
    own = pd.read_parquet(path) if ending == "parquet" else pd.read_feather(path).set_index("time")
    rate = 1 / own.index.diff().mean().total_seconds()
    same(imported(path), ["A1", "A2"], [own["A1 [g]"], own["A2 [g]"]], rate, "m/s2", G)


@pytest.mark.parametrize("index", [None, False, True])
def test_parquet_of_pandas(tmp_path, index):
    """A frame with a counter for an index, stored or not: it is no channel and no time."""
    frame = pd.DataFrame({"t [s]": TIME, "A1 [g]": noise(45), "A2 [g]": noise(46)}, index=np.arange(5, COUNT + 5))
    frame.to_parquet(tmp_path / "p.parquet", index=index)
    own = pd.read_parquet(tmp_path / "p.parquet")
    same(imported(tmp_path / "p.parquet"), ["A1", "A2"], [own["A1 [g]"], own["A2 [g]"]], RATE, "m/s2", G)


@pytest.mark.parametrize(
    "dtype, chunk, compression",
    [(dtype, None, "lz4") for dtype in ["f4", *INTEGERS]]
    + [("f8", chunk, packed) for chunk in [None, 300] for packed in ["uncompressed", "lz4", "zstd"]],
)
def test_feather(tmp_path, dtype, chunk, compression):
    """Every type and compression, in one batch and in several."""
    feather.write_feather(table(dtype, "t [s]", "g"), tmp_path / "f.feather", compression, chunksize=chunk)
    own = feather.read_table(tmp_path / "f.feather")
    rate = 1 / np.diff(own["t [s]"].to_numpy()).mean()
    same(imported(tmp_path / "f.feather"), ["A1", "A2"], columns_of(own), rate, "m/s2", G)


@pytest.mark.parametrize("ending", ["parquet", "feather"])
def test_arrow_rate_of_the_schema(tmp_path, ending):
    """No time column, the rate in the schema's metadata; with missing values refused."""
    path, whole = tmp_path / f"a.{ending}", table("f8", None, "m/s2", RATE)
    write = parquet.write_table if ending == "parquet" else feather.write_feather
    read = parquet.read_table if ending == "parquet" else feather.read_table
    write(whole, path)
    own = read(path)
    same(imported(path), ["A1", "A2"], columns_of(own), float(own.schema.metadata[b"sample_rate_hz"]), "m/s2")
    holes = pa.array([None if k == 7 else 1.0 * k for k in range(COUNT)])
    write(whole.set_column(0, whole.schema.field(0), holes), path)
    refused(path, "a1")
