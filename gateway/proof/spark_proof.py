"""Proof: verdicts of generated records by the command one by one, by a pool, and by PySpark are the same row by row.

Records are made by `meshband simulate` (seeds in the table), healthy and with effects; one folder is no record at all, one has a
damaged file. A Spark worker is killed while it works, and a job that was stopped is started again on its store.
"""

import argparse
import json
import os
import pathlib
import signal
import subprocess
import tempfile
import threading
import time

import pyarrow as pa

from meshband_fleet import local, spark, verdicts

#: What the records hold, by turns.
CONTENTS = (
    ["--noise", "0.1"],
    ["--noise", "0.1", "--effect", "eccentricity:amplitude=3e-5"],
    ["--noise", "0.3"],
    ["--noise", "0.1", "--effect", "tooth-crack:loss=0.2,tooth=3"],
)


def make(program, machine, folder, count):
    """Generated records and two that are none."""
    made = []
    for number in range(count - 2):
        record = folder / f"record-{number:04}"
        words = [program, "simulate", machine, "--output", record, "--duration", "2", "--seed", str(number + 1)]
        subprocess.run([*words, "--random-start", *CONTENTS[number % len(CONTENTS)]], check=True, capture_output=True)
        made.append(record)
    empty, damaged = folder / "record-empty", folder / "record-damaged"
    empty.mkdir()
    damaged.mkdir()
    for path in made[0].iterdir():
        (damaged / path.name).write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return made + [empty, damaged]


def kill_a_worker(stop, killed):
    """Kills one Python worker of Spark that runs the command, once."""
    while not stop.is_set() and not killed:
        for entry in pathlib.Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
                status = (entry / "status").read_text()
            except OSError:
                continue
            parent = next((int(line.split()[1]) for line in status.splitlines() if line.startswith("PPid:")), 0)
            # Ours only, and a worker: a child of the daemon whose chain of parents ends in this process.
            if b"pyspark.daemon" in words and b"pyspark.daemon" in command_line(parent) and descends(parent, os.getpid()):
                os.kill(int(entry.name), signal.SIGKILL)
                killed.append(int(entry.name))
                return
        time.sleep(0.05)


def command_line(process):
    """Its words, none where it is gone."""
    try:
        return pathlib.Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return []


def descends(process, ancestor):
    """Whether a process comes from another."""
    while process > 1 and process != ancestor:
        try:
            status = pathlib.Path(f"/proc/{process}/status").read_text()
        except OSError:
            return False
        process = next((int(line.split()[1]) for line in status.splitlines() if line.startswith("PPid:")), 0)
    return process == ancestor


def timed(work):
    begun = time.monotonic()
    value = work()
    return value, round(time.monotonic() - begun, 1)


def killed_run(records, options):
    stop, killed = threading.Event(), []
    watcher = threading.Thread(target=kill_a_worker, args=(stop, killed))
    watcher.start()
    try:
        return spark.run(records, workers=2, **options), len(killed)
    finally:
        stop.set()
        watcher.join()


def prove(arguments, folder):
    machine = arguments.program.resolve().parents[2] / "machines" / "20-40.toml"
    records = make(arguments.program, machine, folder, arguments.records)
    options = {"program": str(arguments.program), "patience": 300.0}
    one_by_one, serial = timed(lambda: pa.Table.from_batches(verdicts.mapper(**options)([verdicts.batch(records)])))
    pool, pool_seconds = timed(lambda: local.run(records, workers=2, **options))
    result = {
        "records": len(records),
        "status": {s: one_by_one.column("status").to_pylist().count(s) for s in ("ok", "failed", "timeout")},
        "seconds one by one": serial,
        "seconds, pool of 2": pool_seconds,
        "core seconds per record, one by one": round(serial / len(records), 3),
        "rows that differ, pool": verdicts.same(one_by_one, pool),
    }
    for workers in (1, 2):
        table, seconds = timed(lambda workers=workers: spark.run(records, workers=workers, **options))
        result[f"seconds, Spark with {workers}"] = seconds
        result[f"rows that differ, Spark with {workers}"] = verdicts.same(one_by_one, table)
    (table, killed), _ = timed(lambda: killed_run(records, options))
    result["Spark workers killed"] = killed
    result["rows that differ, a Spark worker killed"] = verdicts.same(one_by_one, table)
    store = folder / "store"
    local.run(records[: len(records) // 2], workers=2, store=str(store), **options)
    before = {path.name: path.stat().st_mtime_ns for path in store.iterdir()}
    table, seconds = timed(lambda: spark.run(records, workers=2, partitions=3, store=str(store), **options))
    result["seconds, Spark on a half-filled store"] = seconds
    result["answers taken from the store"] = sum(before.get(p.name) == p.stat().st_mtime_ns for p in store.iterdir())
    result["rows that differ, resumed"] = verdicts.same(one_by_one, table)
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--records", type=int, default=40)
    parser.add_argument("--json", type=pathlib.Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="meshband-spark-") as temporary:
        result = prove(arguments, pathlib.Path(temporary))
    text = json.dumps(result, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    if any(value for name, value in result.items() if name.startswith("rows that differ")):
        raise SystemExit("rows differ: see above")


if __name__ == "__main__":
    main()
