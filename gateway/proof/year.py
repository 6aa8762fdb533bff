"""A year of many nodes, rolled up and thinned day by day: sizes, extremes, and times of trends.

A year at the rate of live nodes is 13 thousand million rows. So two runs: days of a few nodes at that rate give the raw rows and the
minutes per node and day, and a year of all nodes with values every ten minutes gives the rest: hours and days, whose size does
not depend on the rate, the share of raw rows that stays, and extremes, compared by the program with what it made up. Queries run
in a process of their own, on two threads, reading files that may be in the system's memory.
"""

import argparse
import json
import os
import pathlib
import re
import resource
import subprocess
import sys
import tempfile
import time

#: Days that raw rows and minutes stay.
RAW_DAYS, MINUTE_DAYS = 2, 14
#: Nodes, days, and seconds between values of the run at the rate of live nodes: four messages each time are 42 MB a day and more.
RATE = {"nodes": 4, "days": 1, "interval": 2}
THREADS = 2

QUERIES = {
    "a year's trend, days": "lake.trend(c, 'node-00075', level='day')",
    "a year's trend, hours": "lake.trend(c, 'node-00075')",
    "a year's trend as the page draws it": "page.commonest(c, 'node-00075', 'rms')[1]",
    "machines that drift over the year": "lake.drifting(c, 'rms')",
    "departures of the last week": "lake.departures(c, 'rms', 7)",
    "overview of all nodes": "lake.overview(c)",
}

#: Ranges of days of the raw rows that stay whole, and of the rollups: how many, how many differ.
EXTREMES = """
    with raw as (select machine, node, date_trunc('day', time) as start, min({q}) as least, max({q}) as most, count({q}) as rows
        from history where day > (select max(day) from history) - {days} group by all having count({q}) > 0),
    rolled as (select machine, node, start, min({q}_min) as least, max({q}_max) as most, sum({q}_count) as rows
        from rollup_{level} where {q}_count > 0 group by machine, node, start)
    select count(*), count(*) filter (rolled.least is distinct from raw.least or rolled.most is distinct from raw.most
        or rolled.rows is distinct from raw.rows)
    from raw left join (select machine, node, date_trunc('day', start) as start, min(least) as least, max(most) as most, sum(rows) as rows
        from rolled group by all) rolled using (machine, node, start)"""


def synthesise(gateway, folder, **options):
    """Runs the command; gives its figures in kB per node and day: raw rows as written, and what stays of them and of each level."""
    log = folder.with_suffix(".txt")
    if not log.is_file():
        words = [gateway, "synthesise", folder / "history", "--spectra", "--rollup", folder / "history-rollup"]
        for name, value in options.items():
            words += ["--" + name.replace("_", "-"), value]
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SystemExit(done.stdout + done.stderr)
        log.write_text(done.stdout)
    text = log.read_text()
    print(text, flush=True)
    rows = re.findall(r"^\| (raw rows that stay|minute|hour|day|all) \| [\d.]+ \| ([\d.]+) \| *(\d*) *\| *(\d*) *\|", text, re.M)
    figures = {name: float(kilobytes) for name, kilobytes, *_ in rows}
    figures["raw"] = float(re.search(r"([\d.]+) kB per node and day", text)[1])
    figures["rows"] = int(re.search(r"(\d+) rows,", text)[1])
    figures["differ"] = sum(int(differ) for *_, differ in rows if differ)
    return figures


def ask(history, expression):
    """Runs in the child: seconds with the view's opening, rows, peak memory in MB."""
    from meshband_fleet import lake, page

    begun = time.monotonic()
    connection = lake.open_history(history)
    connection.sql(f"set threads = {THREADS}")
    answer = eval(expression, {"lake": lake, "page": page, "c": connection})  # expressions of this file alone
    rows = answer if isinstance(answer, list) else answer.fetchall()
    taken = time.monotonic() - begun
    print(json.dumps([taken, len(rows), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]))


def rows_left(history):
    from meshband_fleet import lake

    return lake.open_history(history).sql("select count(*) from history").fetchall()[0][0]


def extremes(history):
    """Ranges of figures on days whose raw rows are whole: how many were compared with the rollups, how many differ."""
    from meshband_fleet import lake

    connection, compared, differ = lake.open_history(history), 0, 0
    for level in ("minute", "hour", "day"):
        for quantity in lake.QUANTITIES:
            some, wrong = connection.sql(EXTREMES.format(q=quantity, days=RAW_DAYS, level=level)).fetchall()[0]
            compared, differ = compared + some, differ + wrong
    return compared, differ


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gateway", type=pathlib.Path)
    parser.add_argument("--nodes", type=int, default=100)
    parser.add_argument("--days", type=int, default=365)
    parser.add_argument("--interval", type=int, default=600, help="seconds between values of the year")
    parser.add_argument("--json", type=pathlib.Path, help="where the figures go")
    parser.add_argument("--keep", type=pathlib.Path, help="folder to work in, kept; what is there already is not made again")
    parser.add_argument("--ask", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.ask:
        return ask(arguments.ask[0], QUERIES[arguments.ask[1]])
    with tempfile.TemporaryDirectory(prefix="meshband-year-") as temporary:
        folder = arguments.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        return measure(arguments, folder)


def measure(arguments, folder):
    rate = synthesise(arguments.gateway, folder / "rate", **RATE)
    thinned = {"raw_days": RAW_DAYS, "minute_days": MINUTE_DAYS}
    year = synthesise(
        arguments.gateway, folder / "year", nodes=arguments.nodes, days=arguments.days, interval=arguments.interval, **thinned)
    # By rows: where few stay of a day, most of a file is its footer, which live nodes' rows outweigh.
    stays = rows_left(folder / "year/history") / year["rows"]
    parts = {
        "raw rows": stays * rate["raw"],
        "minutes": rate["minute"] * MINUTE_DAYS / arguments.days,
        "hours": year["hour"],
        "days": year["day"],
    }
    share = sum(parts.values()) / rate["raw"]
    compared, differ = extremes(folder / "year/history")
    result = {
        "nodes": arguments.nodes,
        "days": arguments.days,
        "raw rows at the rate of live nodes, kB per node and day": round(rate["raw"]),
        "raw rows that stay, share": round(stays, 5),
        "of which of the last days": round(RAW_DAYS / arguments.days, 5),
        "what stays, kB per node and day": {name: round(size, 1) for name, size in parts.items()},
        "what stays, share of the raw rows": round(share, 5),
        "ranges that differ from what was made up": int(year["differ"] + rate["differ"]),
        "ranges compared with raw rows that stay": compared,
        "of which differ": differ,
        "queries: s, rows, peak MB": {},
    }
    for name in QUERIES:
        words = [sys.executable, __file__, arguments.gateway, "--ask", folder / "year/history", name]
        done = subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True)
        seconds, rows, peak = json.loads(done.stdout)
        result["queries: s, rows, peak MB"][name] = [round(seconds, 2), rows, round(peak)]
    result["load of the last minute"] = round(os.getloadavg()[0], 1)
    text = json.dumps(result, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    trends = [seconds for name, (seconds, *_) in result["queries: s, rows, peak MB"].items() if "trend" in name]
    if share > 0.01 or differ or year["differ"] or rate["differ"] or max(trends) > 2.0:
        raise SystemExit("the claim does not hold: at most 1 % of the raw rows, no extreme that differs, a trend within 2 s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
