"""Five programs open the same folders with one line each and give the same sums: Spark, DuckDB, polars, pyarrow, pandas.

Folders: exports of a captured link; a history and its rollups, thinned; a history of a gateway that writes and merges meanwhile.
Of the last one each program is asked in turn: rows in front of the gateway's place in the journal must be there once each. A program
that listed a file which a merge then replaced gives an error, and is asked again; a wrong sum is never right.
"""

import argparse
import collections
import json
import math
import os
import pathlib
import socket
import tempfile
import threading
import time

import duckdb
import pandas
import polars
import pyarrow.compute
import pyarrow.dataset
import pyarrow.parquet

import kit

#: The one line of each program; each gives a frame of its own kind.
LINES = {
    "Spark": lambda spark, folder: spark.read.parquet(folder),
    "DuckDB": lambda _, folder: duckdb.sql(f"from '{folder}/**/*.parquet'"),
    "polars": lambda _, folder: polars.read_parquet(f"{folder}/**/*.parquet", hive_partitioning=True),
    "pyarrow": lambda _, folder: pyarrow.dataset.dataset(folder, partitioning="hive").to_table(),
    "pandas": lambda _, folder: pandas.read_parquet(folder),
}
#: What an error says where a file that was listed has been replaced since.
REPLACED = ("No such file", "NoSuchFile", "No files found", "does not exist", "FileNotFound", "FILE_NOT_EXIST", "Cannot open file", "not found")


def session():
    """Spark in local mode, or `None` where it or Java is not there."""
    try:
        from pyspark.sql import SparkSession

        builder = SparkSession.builder.master("local[2]").appName("readers").config("spark.ui.enabled", "false")
        builder = builder.config("spark.driver.bindAddress", "127.0.0.1").config("spark.driver.host", "127.0.0.1")
        builder = builder.config("spark.sql.session.timeZone", "UTC").config("spark.ui.showConsoleProgress", "false")
        spark = builder.getOrCreate()
    except Exception as reason:  # Java reports through several classes
        print(f"Spark is not to be had here and is SKIPPED: {str(reason).splitlines()[0]}")
        return None
    spark.sparkContext.setLogLevel("OFF")
    return spark


def columns(name, frame, wanted):
    """Columns as lists."""
    if name == "Spark":
        rows = frame.select(*wanted).collect()
        return [[row[column] for row in rows] for column in wanted]
    if name == "DuckDB":
        rows = frame.select(*wanted).fetchall()
        return [[row[place] for row in rows] for place in range(len(wanted))]
    if name == "polars":
        return [frame[column].to_list() for column in wanted]
    if name == "pyarrow":
        return [frame[column].to_pylist() for column in wanted]
    return [frame[column].tolist() for column in wanted]


def sums(name, frame, number, figure, below=None):
    """Rows, sum of the numbers, sum and range of a figure, machines, days: what all programs must agree on."""
    numbers, figures, machines, days = columns(name, frame, (number, figure, "machine", "day"))
    keep = [place for place, held in enumerate(numbers) if below is None or held < below]
    held = [float(figures[place]) for place in keep if figures[place] is not None and not math.isnan(figures[place])]
    return {
        "rows": len(keep),
        "sum of numbers": int(sum(int(numbers[place]) for place in keep)),
        "figures": len(held),
        "sum": math.fsum(held),
        "least": min(held, default=None),
        "most": max(held, default=None),
        "machines": dict(collections.Counter(str(machines[place]) for place in keep)),
        "days": dict(collections.Counter(str(days[place])[:10] for place in keep)),
    }


def agree(what, spark, folder, number, figure):
    """All programs on one folder; gives how many there were."""
    answers = {}
    for name, line in LINES.items():
        if name == "Spark" and spark is None:
            continue
        answers[name] = sums(name, line(spark, str(folder)), number, figure)
    first = next(iter(answers.values()))
    for name, answer in answers.items():
        if answer != first:
            raise SystemExit(f"{what}: {name} differs\n{json.dumps(answers, indent=1)}")
    machines = len(first["machines"])
    print(f"| {what} | {', '.join(answers)} | {first['rows']} | {machines} | {first['sum']:.6f} | 0 |", flush=True)
    return len(answers)


class Tap:
    """Between a gateway and a node: keeps what the node sends, which is what `meshband monitor --record` keeps."""

    def __init__(self, port, path):
        self.server, self.node, self.path = socket.create_server(("127.0.0.1", 0)), port, path
        self.port = self.server.getsockname()[1]
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        near, _ = self.server.accept()
        far = socket.create_connection(("127.0.0.1", self.node))
        threading.Thread(target=self.pass_on, args=(near, far, None), daemon=True).start()
        with self.path.open("wb") as file:
            self.pass_on(far, near, file)

    @staticmethod
    def pass_on(source, sink, file):
        try:
            while data := source.recv(4096):
                if file:
                    file.write(data)
                    file.flush()
                sink.sendall(data)
        except OSError:
            pass


def exports(gateway, folder, captures):
    """A folder of exports of two captured links under three names."""
    out = folder / "exports"
    for index, capture in enumerate(captures):
        words = [gateway, "export", capture, out, "--node", f"node-{index}", "--machine", f"mill-{index}", "--from", 1_767_225_600]
        process = kit.Process(words, folder / "export.log").start()
        if process.wait(60) != 0:
            raise SystemExit(process.text())
    return out


def synthesised(gateway, folder):
    """A history of three days and its rollups, thinned by rule."""
    history, rollup = folder / "made/history", folder / "made/history-rollup"
    words = [gateway, "synthesise", history, "--nodes", 40, "--per-machine", 4, "--days", 4, "--interval", 120, "--rollup", rollup]
    process = kit.Process([*words, "--raw-days", 2, "--minute-days", 2], folder / "synthesise.log").start()
    if process.wait(300) != 0:
        raise SystemExit(process.text())
    return history, rollup


def asked(name, spark, folder, below):
    """A program on the folder that is being written: its answer, or `None` where a listed file was replaced."""
    try:
        return sums(name, LINES[name](spark, str(folder)), "journal", "rms", below)
    except Exception as reason:  # each program has errors of its own
        text = f"{type(reason).__name__} {reason}"
        if any(said in text for said in REPLACED):
            return None
        raise


def while_written(arguments, folder, spark, live):
    """Programs in turn on the history of a running gateway."""
    cursor, history = folder / "data/history.cursor", folder / "history"
    kit.until(lambda: cursor.is_file() and int(cursor.read_text()) > 50, 30, "first files")
    names = [name for name in LINES if name != "Spark" or spark is not None]
    counts = {name: collections.Counter() for name in names}
    end, at = time.monotonic() + arguments.seconds, 0
    while time.monotonic() < end or at % len(names):
        name = names[at % len(names)]
        at += 1
        below = int(cursor.read_text())
        answer = asked(name, spark, history, below)
        if answer is None:
            counts[name]["asked again"] += 1
            continue
        counts[name]["answers"] += 1
        truth = (below, below * (below - 1) // 2)
        if (answer["rows"], answer["sum of numbers"]) != truth:
            raise SystemExit(f"{name} while the gateway writes: {answer['rows']} rows, sum {answer['sum of numbers']}, not {truth}")
    for name, count in counts.items():
        if count["answers"] == 0:
            raise SystemExit(f"{name} had no answer while the gateway wrote, asked {count['asked again']} times")
        print(f"| while written, {count['answers']} times | {name} | to {below} | 3 | | asked again {count['asked again']} |", flush=True)
    live.stop()


def run(arguments, folder):
    spark = session()
    first = kit.free_ports(6)
    nodes = kit.Process([arguments.gateway, "nodes", "--count", 6, "--port", first], folder / "nodes.log").start()
    captures = [folder / "0.link", folder / "1.link"]
    try:
        kit.until(lambda: "nodes on" in nodes.text(), 10, "nodes listen")
        taps = [Tap(first + index, path) for index, path in enumerate(captures)]
        ports = [tap.port for tap in taps] + [first + index for index in range(2, 6)]
        config = kit.configure(folder, ports, machines=3)
        # Merged every few seconds, some 200 times as often as by default.
        config.write_text(config.read_text().replace("flush_seconds = 2\ncompact_files = 8", "flush_seconds = 1\ncompact_files = 4"))
        live = kit.Process([arguments.gateway, config], folder / "gateway.log").start()
        print("| folder | program | rows | machines | sum | differ |\n| --- | --- | --- | --- | --- | --- |", flush=True)
        try:
            while_written(arguments, folder, spark, live)
        finally:
            live.stop()
    finally:
        nodes.stop()
    programs = agree("history of a gateway", spark, folder / "history", "journal", "rms")
    agree("exports", spark, exports(arguments.gateway, folder, captures), "journal", "rms")
    history, rollup = synthesised(arguments.gateway, folder)
    agree("thinned history", spark, history, "journal", "rms")
    agree("rollups", spark, rollup, "frames", "rms_max")
    print(f"{programs} programs; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    if spark is not None:
        spark.stop()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gateway", type=pathlib.Path, help="the meshband-gateway program")
    parser.add_argument("--seconds", type=int, default=60, help="how long the programs read while the gateway writes")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="meshband-readers-") as temporary:
        run(arguments, pathlib.Path(temporary))


if __name__ == "__main__":
    main()
