"""meshband-fleet: the fleet page, queries and jobs from the command line."""

import argparse
import json
import pathlib
import sys

import duckdb

from . import lake, page, records

#: Times a question is asked while a gateway merges or thins the files it is asked of.
ATTEMPTS = 3


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="meshband-fleet", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    pages = commands.add_parser("page", help="static HTML: overview, and a page per node")
    pages.add_argument("history", type=pathlib.Path)
    pages.add_argument("folder", type=pathlib.Path)
    for name, about in (("departures", "nodes that left their own past"), ("drift", "machines that drift")):
        query = commands.add_parser(name, help=about)
        query.add_argument("history", type=pathlib.Path)
        query.add_argument("--quantity", default="rms", choices=lake.QUANTITIES)
    trend = commands.add_parser("trend", help="hourly means of a node at like speed")
    trend.add_argument("history", type=pathlib.Path)
    trend.add_argument("node")
    trend.add_argument("--quantity", default="rms", choices=lake.QUANTITIES)
    sql = commands.add_parser("sql", help="any query on the view `history`")
    sql.add_argument("history", type=pathlib.Path)
    sql.add_argument("query")
    trend.add_argument("--level", default="hour", choices=("minute", "hour", "day"))
    for query in commands.choices.values():
        query.add_argument("--rollup", type=pathlib.Path, help="folder of rollups; HISTORY-rollup where none is given")
    export = commands.add_parser("export", help="record folders as Parquet, one file each: waveforms and tach edges as lists")
    export.add_argument("folder", type=pathlib.Path)
    export.add_argument("records", nargs="+", type=pathlib.Path)
    jobs = commands.add_parser("verdicts", help="`meshband loop` or `analyse` over many records, into a Parquet file")
    jobs.add_argument("output", type=pathlib.Path)
    jobs.add_argument("records", nargs="+")
    jobs.add_argument("--analyse", action="store_true", help="`analyse` instead of `loop`")
    jobs.add_argument("--store", type=pathlib.Path, help="answers kept here; a job started again takes them")
    jobs.add_argument("--workers", type=int, default=2)
    jobs.add_argument("--program", default="meshband")
    jobs.add_argument("--spark", action="store_true", help="PySpark in local mode instead of a pool")
    given = parser.parse_args(arguments)
    try:
        for attempt in range(ATTEMPTS):
            try:
                return run(given)
            except duckdb.IOException:
                # The gateway replaced files between listing and reading.
                if attempt + 1 == ATTEMPTS:
                    raise
    except (OSError, ValueError, duckdb.Error) as reason:
        print(f"meshband-fleet: {str(reason).splitlines()[0]}", file=sys.stderr)
        return 2


def run(given):
    if given.command == "page":
        print(page.write(given.history, given.folder, given.rollup))
        return 0
    if given.command == "verdicts":
        return verdicts(given)
    if given.command == "export":
        return export(given)
    connection = lake.open_history(given.history, rollup=given.rollup)
    if given.command == "departures":
        relation = lake.departures(connection, given.quantity)
    elif given.command == "drift":
        relation = lake.drifting(connection, given.quantity)
    elif given.command == "trend":
        rows = lake.trend(connection, given.node, given.quantity, level=given.level).fetchall()
        for row in rows:
            print("\t".join(str(cell) for cell in row))
        return 0
    else:
        relation = connection.sql(given.query)
    if relation is not None:
        relation.show(max_rows=1000)
    return 0


def export(given):
    """All that can be; the others are named, and the exit code says that there were some."""
    failed = 0
    for record in given.records:
        try:
            print(records.export(record, given.folder))
        except (OSError, ValueError) as reason:
            failed += 1
            print(f"meshband-fleet: {str(reason).splitlines()[0]}", file=sys.stderr)
    return 2 if failed else 0


def verdicts(given):
    import pyarrow.parquet

    from . import local, spark

    engine = spark if given.spark else local
    command = ("analyse",) if given.analyse else ("loop",)
    table = engine.run(given.records, command, given.workers, program=given.program, store=given.store)
    temporary = given.output.with_suffix(".new")
    pyarrow.parquet.write_table(table, temporary)
    temporary.replace(given.output)
    counts = {}
    for status in table.column("status").to_pylist():
        counts[status] = counts.get(status, 0) + 1
    print(json.dumps({"records": table.num_rows, **counts}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
