"""Sizes and times: a day of many nodes written by `meshband-gateway synthesise`, then asked by DuckDB with bounded memory.

Each query runs in a process of its own, so that its peak memory is its own.
"""

import argparse
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

QUERIES = {
    "overview of all nodes": "lake.overview(c)",
    "worst departures (RMS) of the last six hours": "lake.departures(c, 'rms', 0.25)",
    "machines that drift (RMS)": "lake.drifting(c, 'rms')",
    "one node's trend at like speed": "lake.trend(c, 'node-00075')",
    "one node's last hour, all columns": "c.sql(\"select * from history where machine = 'machine-0007' and node = 'node-00075'"
    " and time > (select max(time) - interval 1 hour from history where machine = 'machine-0007')\")",
}


def ask(history, expression, memory):
    """Runs in the child: seconds of the query, rows, peak memory in MB."""
    from meshband_fleet import lake

    begun = time.monotonic()
    connection = lake.open_history(history, memory)
    opened = time.monotonic()
    rows = eval(expression, {"lake": lake, "c": connection}).fetchall()  # expressions of this file alone
    done = time.monotonic()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{opened - begun:.2f} | {done - opened:.2f} | {len(rows)} | {peak:.0f}")


def load():
    """What else the machine does: times mean little where it is far above the writer's one."""
    return f"load of 1, 5, 15 minutes {' '.join(f'{value:.1f}' for value in os.getloadavg())} on {os.cpu_count()} cores"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gateway", type=pathlib.Path)
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--interval", type=int, default=10)
    parser.add_argument("--memory", default="1GB")
    parser.add_argument("--ask", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.ask:
        return ask(arguments.ask[0], QUERIES[arguments.ask[1]], arguments.memory)
    with tempfile.TemporaryDirectory(prefix="meshband-day-") as folder:
        history = pathlib.Path(folder) / "history"
        words = [arguments.gateway, "synthesise", history, "--nodes", arguments.nodes, "--interval", arguments.interval]
        subprocess.run([str(word) for word in words], check=True)
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        processor = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(f"writer's peak memory: {peak:.0f} MB; processor: {processor.ru_utime + processor.ru_stime:.0f} s; {load()}\n", flush=True)
        print("| query | view, s | query, s | rows | peak, MB |\n| --- | --- | --- | --- | --- |")
        for name in QUERIES:
            words = [sys.executable, __file__, arguments.gateway, "--memory", arguments.memory, "--ask", history, name]
            done = subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True)
            print(f"| {name} | {done.stdout.strip()} |", flush=True)
        print(load())
    return 0


if __name__ == "__main__":
    sys.exit(main())
