"""Proof: verdicts of generated records by the command one by one, by a pool, and by PySpark are the same row by row.

Records are made by `meshband simulate` (seed: the record's number), healthy and with effects; one folder is no record at all, one
has a damaged file. A Spark worker is killed while the command answers it, and a job that was stopped half way is started again on
its store. Times are of the wall clock with Spark's own start in them, so the machine's load stands beside them.
"""

import argparse
import json
import os
import pathlib
import resource
import signal
import subprocess
import tempfile
import threading
import time

import pyarrow as pa

from meshband_fleet import local, spark, verdicts

MACHINE = pathlib.Path(__file__).resolve().parents[2] / "machines" / "20-40.toml"

#: What the records hold, by turns.
CONTENTS = (
    ["--noise", "0.1"],
    ["--noise", "0.1", "--effect", "eccentricity:amplitude=3e-5"],
    ["--noise", "0.3"],
    ["--noise", "0.1", "--effect", "tooth-crack:loss=0.2,tooth=3"],
)


def make(arguments, folder):
    """Generated records and two that are none."""
    size = ["--duration", str(arguments.duration), "--rate", str(arguments.rate), "--random-start"]
    made = []
    for number in range(arguments.records - 2):
        record = folder / f"record-{number:04}"
        words = [arguments.program, "simulate", MACHINE, "--output", record, "--seed", str(number + 1), *size]
        subprocess.run([*words, *CONTENTS[number % len(CONTENTS)]], check=True, capture_output=True)
        made.append(record)
    empty, damaged = folder / "record-empty", folder / "record-damaged"
    empty.mkdir()
    damaged.mkdir()
    for path in made[0].iterdir():
        (damaged / path.name).write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return made + [empty, damaged]


def kill_a_worker(program, stop, killed):
    """Kills one Python worker of Spark while the command works for it, once."""
    while not stop.is_set():
        for entry in pathlib.Path("/proc").iterdir():
            if not entry.name.isdigit() or command_line(entry.name)[0] != program.encode():
                continue
            worker = parent(int(entry.name))
            # Ours only, and a worker: a child of the daemon whose chain of parents ends in this process.
            workers = b"pyspark.daemon" in command_line(worker) and b"pyspark.daemon" in command_line(parent(worker))
            if workers and descends(worker, os.getpid()):
                os.kill(worker, signal.SIGKILL)
                killed.append(worker)
                return
        time.sleep(0.05)


def parent(process):
    """Its parent, 0 where it is gone."""
    try:
        status = pathlib.Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in status.splitlines() if line.startswith("PPid:")), 0)


def command_line(process):
    """Its words, an empty one where it is gone."""
    try:
        return pathlib.Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return [b""]


def descends(process, ancestor):
    """Whether a process comes from another."""
    while process > 1 and process != ancestor:
        process = parent(process)
    return process == ancestor


def timed(work):
    begun = time.monotonic()
    value = work()
    seconds = round(time.monotonic() - begun, 1)
    print(f"{seconds} s, load {os.getloadavg()[0]:.1f}", flush=True)
    return value, seconds


def killed_run(records, options):
    stop, killed = threading.Event(), []
    watcher = threading.Thread(target=kill_a_worker, args=(options["program"], stop, killed))
    watcher.start()
    try:
        return spark.run(records, workers=2, **options), len(killed)
    finally:
        stop.set()
        watcher.join()


def prove(arguments, folder):
    records = make(arguments, folder)
    options = {"program": str(arguments.program.resolve()), "patience": 300.0}
    cpu = resource.getrusage(resource.RUSAGE_CHILDREN)
    one_by_one, serial = timed(lambda: pa.Table.from_batches(verdicts.mapper(**options)([verdicts.batch(records)])))
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = used.ru_utime + used.ru_stime - cpu.ru_utime - cpu.ru_stime
    pool, pool_seconds = timed(lambda: local.run(records, workers=2, **options))
    result = {
        "records": len(records),
        "duration of each, s": arguments.duration,
        "rate of each, Hz": arguments.rate,
        "seeds": [1, len(records) - 2],
        "cores": os.cpu_count(),
        "status": {s: one_by_one.column("status").to_pylist().count(s) for s in ("ok", "failed", "timeout")},
        "seconds one by one": serial,
        "processor seconds per record": round(processor / len(records), 3),
        "seconds, pool of 2": pool_seconds,
        "rows that differ, pool": verdicts.same(one_by_one, pool),
    }
    _, result["seconds, Spark for one record"] = timed(lambda: spark.run(records[:1], workers=1, **options))
    for workers in (1, 2):
        table, seconds = timed(lambda workers=workers: spark.run(records, workers=workers, **options))
        result[f"seconds, Spark with {workers}"] = seconds
        result[f"rows that differ, Spark with {workers}"] = verdicts.same(one_by_one, table)
    (table, killed), result["seconds, Spark with 2, a worker killed"] = timed(lambda: killed_run(records, options))
    result["Spark workers killed"] = killed
    result["rows that differ, a Spark worker killed"] = verdicts.same(one_by_one, table)
    store = folder / "store"
    local.run(records[: len(records) // 2], workers=2, store=str(store), **options)
    before = {path.name: path.stat().st_mtime_ns for path in store.iterdir()}
    table, seconds = timed(lambda: spark.run(records, workers=2, partitions=3, store=str(store), **options))
    result["seconds, Spark on a half-filled store"] = seconds
    result["answers taken from the store"] = sum(before.get(p.name) == p.stat().st_mtime_ns for p in store.iterdir())
    result["rows that differ, resumed"] = verdicts.same(one_by_one, table)
    result["load of the last 15 minutes at the end"] = round(os.getloadavg()[2], 1)
    return result


def scaling(arguments, folder):
    """Times alone, pool and Spark with one and two workers by turns, so that what else runs falls on all alike."""
    records = make(arguments, folder)
    options = {"program": str(arguments.program.resolve()), "patience": 300.0}
    taken = {}
    for _ in range(arguments.times):
        for name, engine in (("pool", local), ("Spark", spark)):
            for workers in (1, 2):
                _, seconds = timed(lambda engine=engine, workers=workers: engine.run(records, workers=workers, **options))
                taken.setdefault(f"seconds, {name} with {workers}", []).append(seconds)
    load = {"load of the last 5 and 15 minutes at the end": [round(value, 1) for value in os.getloadavg()[1:]]}
    return {"records": len(records), "cores": os.cpu_count(), **taken, **load}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--duration", type=float, default=2.0, help="of each record, s")
    parser.add_argument("--rate", type=float, default=12800.0, help="of each record, Hz")
    parser.add_argument("--times", type=int, help="instead of the proof: so many turns of pool and Spark, 1 and 2 workers")
    parser.add_argument("--json", type=pathlib.Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="meshband-spark-") as temporary:
        result = (scaling if arguments.times else prove)(arguments, pathlib.Path(temporary))
    text = json.dumps(result, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    if arguments.times:
        return
    if any(value for name, value in result.items() if name.startswith("rows that differ")):
        raise SystemExit("rows differ: see above")
    if result["Spark workers killed"] != 1:
        raise SystemExit("no worker was killed: see above")


if __name__ == "__main__":
    main()
