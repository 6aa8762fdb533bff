"""The Parquet history and its rollups as DuckDB views, and the questions asked of them most.

`history` are the raw rows, `rollup_minute`, `rollup_hour` and `rollup_day` the buckets, `fresh` the raw rows that no rollup has yet:
buckets of a level and fresh rows have everything once, also when most raw rows are gone. A view's files are opened by each question,
so there is one of each level. `history` leaves out files whose range of entries lies inside
another's of the same partition: where a gateway cannot exchange a partition in one step, both are there for a moment.
"""

import json
import pathlib
import re

import duckdb

PART = re.compile(r"part-(\d+)-(\d+)\.parquet$")
QUOTED = re.compile(r"'(?:[^']|'')*'")
#: The gateway's list of what is rolled up, in the rollups' folder.
LEDGER = "_units.jsonl"
#: Width of the rollups' speed classes, Hz.
SPEED_STEP_HZ = 1.0
#: Times the list is read again where the gateway was adding to it.
ATTEMPTS = 5
#: Without types a machine named 0x10 would be the number 16, and one named inf a date.
KINDS = "hive_partitioning = true, hive_types = {'machine': VARCHAR, 'day': DATE}, union_by_name = true"
ROLLUP_KINDS = KINDS.replace("{", "{'level': VARCHAR, ")
LEVELS = ("minute", "hour", "day")

#: Columns of the history that are figures of a machine's condition.
QUANTITIES = (
    "rms", "peak", "crest", "kurtosis", "sideband_energy_ratio", "gear_rms", "fm0", "fm4", "m6a", "na4",
    "gear_sideband_energy_ratio", "measured_bandwidth_hz", "mesh_1", "mesh_2", "mesh_3", "wideband_rms",
    "velocity_rms", "pinion_1", "pinion_2", "pinion_3", "gear_1", "gear_2", "gear_3",
    "second_rms", "second_peak", "second_crest", "second_kurtosis", "second_velocity_rms",
)


#: Columns of a history of which all raw rows are gone, besides the figures.
COLUMNS = {
    "journal": "ubigint", "received": "timestamptz", "time": "timestamptz", "node": "varchar", "unit": "varchar", "boot": "uinteger",
    "sequence": "usmallint", "kind": "varchar", "state": "varchar", "validity": "varchar", "event": "varchar", "detail": "bigint",
    "text": "varchar", "speed_hz": "float", "quality": "varchar", "machine": "varchar", "day": "date",
}


def parts(folder, above=""):
    """The files that count: machine, day, first and last number, path."""
    counted = []
    for partition in sorted(pathlib.Path(folder).glob(f"{above}machine=*/day=*")):
        held = [(int(m[1]), int(m[2]), path) for path in sorted(partition.iterdir()) if (m := PART.search(path.name))]
        machine, day = partition.parent.name.removeprefix("machine="), partition.name.removeprefix("day=")
        for first, last, path in held:
            if not any(a <= first and last <= b and other != path for a, b, other in held):
                counted.append((machine, day, first, last, str(path)))
    return counted


def files(folder):
    """The raw files that count."""
    root = pathlib.Path(folder)
    if not root.is_dir():
        raise FileNotFoundError(f"{root}: no such folder")
    counted = [path for *_, path in parts(root)]
    if not counted:
        raise FileNotFoundError(f"{root}: no part-*.parquet under machine=*/day=*")
    return counted


def units(rollup):
    """What is rolled up: number of the last entry by machine and day, and of the last unit; a torn line counts for nothing."""
    held, newest = {}, -1
    for line in (pathlib.Path(rollup) / LEDGER).read_text(encoding="utf-8").splitlines():
        try:
            unit = json.loads(line)
        except ValueError:
            continue
        key = (unit["machine"], unit["day"])
        held[key], newest = max(held.get(key, -1), unit["last"]), max(newest, unit["unit"])
    return held, newest


def beside(folder):
    """Where a gateway keeps the rollups of a history unless it is told otherwise; `None` where there are none."""
    root = pathlib.Path(folder).absolute()
    rollup = root.with_name(root.name + "-rollup")
    return rollup if (rollup / LEDGER).is_file() else None


def listed(paths):
    return "[" + ", ".join("'" + path.replace("'", "''") + "'" for path in paths) + "]"


class History:
    """A DuckDB connection whose views are made when a question first names them.

    A view opens the footers of all its files: a question pays for those it names alone. `sql` and `execute` are DuckDB's,
    `views` the names; `connection` has the views that were named so far, and all after `everything`.
    """

    def __init__(self, connection, made):
        self.connection, self.waiting, self.views = connection, made, frozenset(made)

    def named(self, text):
        # A file's path may have a view's name in it.
        text = QUOTED.sub("", text)
        for name in [name for name in self.waiting if re.search(rf"\b{name}\b", text, re.IGNORECASE)]:
            if name in self.waiting:
                query = self.waiting.pop(name)
                self.named(query)
                self.connection.sql(query)
        return self

    def everything(self):
        return self.named(" ".join(self.waiting)).connection

    def sql(self, query):
        return self.named(query).connection.sql(query)

    def execute(self, query, parameters=None):
        return self.named(query).connection.execute(query, parameters)


def open_history(folder, memory="1GB", rollup=None):
    """A `History` with the views `history`, `fresh` and `rollup_LEVEL`; `memory` bounds what DuckDB takes.

    `rollup` is the rollups' folder, by default the one beside the history.
    """
    rollup = rollup or beside(folder)
    connection = duckdb.connect()
    # A question opens a view's files once to know their columns and once to read them: the footers are kept.
    connection.sql(f"set memory_limit = '{memory}'; set TimeZone = 'UTC'; set parquet_metadata_cache = true")
    held, buckets = consistent(rollup) if rollup else ({}, [])
    raw = parts(folder)
    made = {"history": raw_view(folder, raw or not buckets)}
    if not buckets:
        made["fresh"] = "create view fresh as select * from history"
        return History(connection, made)
    for level in LEVELS:
        if held_by := [path for path in buckets if f"/level={level}/" in path]:
            made[f"rollup_{level}"] = f"create view rollup_{level} as select * from read_parquet({listed(held_by)}, {ROLLUP_KINDS})"
    connection.sql("create table units (machine varchar, day date, last ubigint)")
    rows = [[machine for machine, _ in held], [day for _, day in held], list(held.values())]
    connection.execute("insert into units select unnest(?::varchar[]), unnest(?::date[]), unnest(?::ubigint[])", rows)
    fresh = [path for machine, day, _, last, path in raw if last > held.get((machine, day), -1)]
    rows = f"read_parquet({listed(fresh)}, {KINDS})" if fresh else "(select * from history where false)"
    made["fresh"] = f"""create view fresh as select rows.* from {rows} rows left join units using (machine, day)
        where units.last is null or rows.journal > units.last"""
    return History(connection, made)


def raw_view(folder, there):
    """Makes `history`: of its files, or empty where all raw rows are gone."""
    if there:
        return f"create view history as select * from read_parquet({listed(files(folder))}, {KINDS})"
    columns = {**dict.fromkeys(QUANTITIES, "float"), **COLUMNS}
    return "create table history (" + ", ".join(f"{name} {kind}" for name, kind in columns.items()) + ")"


def consistent(rollup):
    """What is rolled up and the files that have it, no more: the gateway may be adding a unit."""
    for _ in range(ATTEMPTS):
        held, newest = units(rollup)
        buckets = parts(rollup, "level=*/")
        if all(last <= newest for *_, last, _ in buckets):
            break
    # What is left is of a unit that was not completed.
    return held, [path for *_, last, path in buckets if last <= newest]


def has_rollup(connection, level="day", quantity=None):
    """Whether there are buckets of a level, and a figure's columns in them."""
    name = f"rollup_{level}"
    return name in connection.views and (quantity is None or f"{quantity}_min" in columns(connection, name))


def known(quantity):
    """The name of a figure's column, or an error that lists them."""
    if quantity not in QUANTITIES:
        raise ValueError(f"{quantity!r} is no quantity; one of: {', '.join(QUANTITIES)}")
    return quantity


def columns(connection, view):
    return {name for name, *_ in connection.sql(f"describe {view}").fetchall()}


def holds(connection, quantity):
    """Whether any file of the history has a figure's column: histories of former schemas lack some."""
    return known(quantity) in columns(connection, "history")


#: Rows whose speed is known.
LOCKED = "speed_hz is not null and coalesce(validity, 'Locked') = 'Locked'"


def buckets(connection, quantity, level="hour"):
    """A query of a figure's buckets at like speed: machine, node, start, speed, least, most, value (mean), rows.

    From the rollups, and from fresh rows what they do not have yet.
    """
    column = known(quantity)
    held = f"""select machine, node, date_trunc('{level}', time) as start, floor(speed_hz / {SPEED_STEP_HZ}) * {SPEED_STEP_HZ}
            + {SPEED_STEP_HZ / 2} as speed, min({column}) as least, max({column}) as most, avg({column}) as value, count({column}) as rows
        from fresh where {column} is not null and {LOCKED} group by all"""
    if has_rollup(connection, level, column):
        held += f""" union all select machine, node, start, speed_class_hz, {column}_min, {column}_max, {column}_mean, {column}_count
            from rollup_{level} where {column}_count > 0 and speed_class_hz is not null"""
    return f"""(select machine, node, start, speed, min(least) as least, max(most) as most, sum(value * rows) / sum(rows) as value,
            sum(rows)::bigint as rows from ({held}) group by all)"""


def departures(connection, quantity="rms", days=7, limit=10):
    """Worst departures of the last days: each node's mean there against its own mean before, in standard deviations.

    Rows: machine, node, now, before, sigma, departure; the largest magnitude first. A node without a day before has none.
    """
    return connection.sql(f"""
        with hours as (
            select machine, node, start as hour, sum(value * rows) / sum(rows) as value
            from {buckets(connection, quantity)} group by all
        ), edge as (select max(hour) - to_seconds({float(days) * 86400}) as since from hours)
        select machine, node,
            avg(value) filter (hour > since) as now,
            avg(value) filter (hour <= since) as before,
            stddev_samp(value) filter (hour <= since) as sigma,
            (now - before) / nullif(sigma, 0) as departure
        from hours, edge group by machine, node having departure is not null
        order by abs(departure) desc limit {int(limit)}""")


def wider(speed_step):
    """A class of several of the rollups': they cannot be divided."""
    if speed_step < SPEED_STEP_HZ or speed_step % SPEED_STEP_HZ:
        raise ValueError(f"speed_step {speed_step}: must be a multiple of {SPEED_STEP_HZ} Hz, the rollups' own")
    return f"(floor(speed / {float(speed_step)}) + 0.5) * {float(speed_step)}"


def trend(connection, node, quantity="rms", speed_step=SPEED_STEP_HZ, level="hour"):
    """A node's means at like speed: begin of the hour, speed (middle of its step, Hz), value, rows, least, most.

    `level` is `minute`, `hour` or `day`; of minutes a gateway keeps the last ones alone.
    """
    if level not in LEVELS:
        raise ValueError(f"{level!r} is no level; one of: {', '.join(LEVELS)}")
    return connection.execute(f"""
        select start, {wider(speed_step)} as step, sum(value * rows) / sum(rows) as value, sum(rows)::bigint as rows,
            min(least) as least, max(most) as most
        from {buckets(connection, quantity, level)} where node = ? group by start, step order by start, step""", [node])


def drifting(connection, quantity="rms", speed_step=SPEED_STEP_HZ, limit=10):
    """Machines that drift: slope of the hourly means at each node's most frequent speed, relative to their mean, per day.

    Rows: machine, node, speed, per_day (share of the mean), r2, hours; largest |per_day| with r2 above 0.3 first.
    """
    return connection.sql(f"""
        with hours as (
            select machine, node, {wider(speed_step)} as step, epoch(start) / 86400 as day, sum(value * rows) / sum(rows) as value
            from {buckets(connection, quantity)} group by all
        ), fits as (
            select machine, node, step as speed, count(*) as hours, regr_slope(value, day) / nullif(avg(value), 0) as per_day,
                regr_r2(value, day) as r2,
                row_number() over (partition by machine, node order by count(*) desc, step) as rank
            from hours group by machine, node, step
        )
        select machine, node, speed, per_day, r2, hours from fits
        where rank = 1 and r2 > 0.3 order by abs(per_day) desc limit {int(limit)}""")


def alarms(connection, limit=50):
    """Newest alarms: time, machine, node, event, detail."""
    return connection.sql(f"""
        select time, machine, node, event, detail from history
        where event in ('AlarmRaised', 'AlarmCleared', 'AlarmsAcknowledged', 'Acknowledged') order by time desc limit {int(limit)}""")


def overview(connection):
    """Every node: machine, node, unit, last seen, state, speed, newest RMS, velocity, kurtosis and FM4, frames, lost ones, alarms."""
    velocity = "null"
    if holds(connection, "velocity_rms"):
        velocity = "arg_max(velocity_rms, journal) filter (velocity_rms is not null)"
    rolled = ""
    if has_rollup(connection):
        rolled = "union all select machine, node, max(start), sum(frames), sum(lost), sum(alarms) from rollup_day group by all"
    return connection.sql(f"""
        with newest as (
            select machine, node, arg_max(unit, journal) as unit, max(received) as seen,
                arg_max(state, journal) filter (state is not null) as state,
                arg_max(speed_hz, journal) filter (speed_hz is not null) as speed,
                arg_max(rms, journal) filter (rms is not null) as rms,
                {velocity} as velocity,
                arg_max(kurtosis, journal) filter (kurtosis is not null) as kurtosis,
                arg_max(fm4, journal) filter (fm4 is not null) as fm4
            from history where node <> '' group by machine, node
        ), counts as (
            select machine, node, max(seen) as seen, sum(frames)::bigint as frames, sum(lost)::bigint as lost, sum(alarms)::bigint as alarms
            from (select machine, node, max(received) as seen, count(sequence) as frames,
                    coalesce(sum(detail) filter (event = 'FramesLost'), 0) as lost, count(*) filter (event = 'AlarmRaised') as alarms
                from fresh where node <> '' group by machine, node {rolled})
            group by machine, node
        )
        select machine, node, coalesce(unit, '') as unit, greatest(newest.seen, counts.seen) as seen, state, speed, rms, velocity, kurtosis,
            fm4, frames, lost, alarms
        from counts left join newest using (machine, node) order by machine, node""")
