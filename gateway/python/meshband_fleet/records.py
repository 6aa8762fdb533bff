"""Record folders as Parquet: one file per record, one row per run and channel, waveforms in the record's unit as list columns.

The file's name is the fingerprint of the record's content: a record that is there is not written again, one that has changed is
another file. Files appear whole or not at all. The format of records is book/src/reference/record.md's; what `meshband` would refuse is
refused here where it matters for the waveforms.
"""

import ast
import csv
import os
import pathlib
import tomllib

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet

from . import verdicts

#: Columns; version 1 (`meshband.records` in the file's metadata). Only ever appended.
SCHEMA = pa.schema([
    ("record", pa.string()),
    ("content", pa.string()),
    ("title", pa.string()),
    ("run", pa.int32()),
    ("channel", pa.string()),
    ("unit", pa.string()),
    ("sample_rate_hz", pa.float64()),
    ("input_torque_n_m", pa.float64()),
    ("signal", pa.list_(pa.float32())),
    ("tach_edges_s", pa.list_(pa.float64())),
], metadata={"meshband.records": "1"})


def codes(path):
    """A NumPy file of int16 or float32, samples x channels: flat array and number of channels."""
    data = path.read_bytes()
    try:
        if data[:6] != b"\x93NUMPY":
            raise ValueError("no NumPy file")
        width = 2 if data[6] == 1 else 4
        start = 8 + width + int.from_bytes(data[8 : 8 + width], "little")
        header = ast.literal_eval(data[8 + width : start].decode("latin-1"))
        samples, channels = header["shape"]
        kind = {"<i2": pa.int16(), "<f4": pa.float32()}[header["descr"]]
        if header["fortran_order"] or len(data) - start != samples * channels * (kind.bit_width // 8):
            raise ValueError("cut off, or not in rows")
    except (ValueError, KeyError, TypeError, SyntaxError, IndexError) as reason:
        raise ValueError(f"{path}: {reason}") from reason
    return pa.Array.from_buffers(kind, samples * channels, [None, pa.py_buffer(data).slice(start)]), channels


def edges(path):
    with path.open(newline="") as file:
        rows = csv.reader(file)
        if next(rows, None) != ["edge_time_s"]:
            raise ValueError(f"{path}: the first line is not edge_time_s")
        return [float(row[0]) for row in rows]


def rows(record):
    """A record's rows, run by run: one table per run."""
    root = pathlib.Path(record)
    declared = tomllib.loads((root / "record.toml").read_text())
    try:
        acquisition, runs = declared["acquisition"], declared["run"]
        names, rate = acquisition["channels"], float(acquisition["sample_rate_hz"])
        scale = float(acquisition["full_scale_m_s2"]) / 32767 if acquisition.get("code_bits", 16) == 16 else 1.0
    except (KeyError, TypeError) as reason:
        raise ValueError(f"{root}/record.toml: lacks {reason}") from reason
    mark = verdicts.content(record)
    for number, run in enumerate(runs):
        flat, channels = codes(root / pathlib.Path(run["signal"]).name)
        if channels != len(names):
            raise ValueError(f"{root}/{run['signal']}: {channels} channels, declared are {len(names)}")
        tach = edges(root / pathlib.Path(run["tach"]).name) if "tach" in run else None
        signals = [pc.multiply(flat[place::channels].cast(pa.float64()), scale).cast(pa.float32()) for place in range(channels)]
        offsets = pa.array(range(0, len(flat) + 1, len(flat) // channels), pa.int32())
        yield pa.table({
            "record": [str(record)] * channels,
            "content": [mark] * channels,
            "title": [declared.get("title")] * channels,
            "run": pa.array([number] * channels, pa.int32()),
            "channel": names,
            "unit": [acquisition.get("unit", "m/s2")] * channels,
            "sample_rate_hz": [rate] * channels,
            "input_torque_n_m": pa.array([run.get("input_torque_n_m")] * channels, pa.float64()),
            "signal": pa.ListArray.from_arrays(offsets, pa.concat_arrays(signals)),
            # Of the run, so with its first channel.
            "tach_edges_s": pa.array([tach] + [None] * (channels - 1), pa.list_(pa.float64())),
        }, schema=SCHEMA)


def export(record, folder):
    """Writes a record's file where it is not there yet; gives its path."""
    out = pathlib.Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"record-{verdicts.content(record)}.parquet"
    if path.exists():
        return path
    temporary = out / f".{path.name}.{os.getpid()}.new"
    try:
        with temporary.open("wb") as file, pyarrow.parquet.ParquetWriter(file, SCHEMA, compression="zstd") as writer:
            for table in rows(record):
                writer.write_table(table)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return path
