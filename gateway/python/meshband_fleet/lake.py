"""The Parquet history as a DuckDB view, and the questions asked of it most.

The view `history` leaves out files whose range of entries lies inside another's of the same partition: between the two steps of
a merge both are there.
"""

import pathlib
import re

import duckdb

PART = re.compile(r"part-(\d+)-(\d+)\.parquet$")

#: Columns of the history that are figures of a machine's condition.
QUANTITIES = (
    "rms", "peak", "crest", "kurtosis", "sideband_energy_ratio", "gear_rms", "fm0", "fm4", "m6a", "na4",
    "gear_sideband_energy_ratio", "measured_bandwidth_hz", "mesh_1", "mesh_2", "mesh_3", "wideband_rms",
    "velocity_rms", "pinion_1", "pinion_2", "pinion_3", "gear_1", "gear_2", "gear_3",
    "second_rms", "second_peak", "second_crest", "second_kurtosis", "second_velocity_rms",
)


def files(folder):
    """The files that count."""
    root = pathlib.Path(folder)
    if not root.is_dir():
        raise FileNotFoundError(f"{root}: no such folder")
    counted = []
    for partition in sorted(root.glob("machine=*/day=*")):
        parts = [(int(m[1]), int(m[2]), path) for path in sorted(partition.iterdir()) if (m := PART.search(path.name))]
        for first, last, path in parts:
            inside = any(a <= first and last <= b and other != path for a, b, other in parts)
            if not inside:
                counted.append(str(path))
    if not counted:
        raise FileNotFoundError(f"{root}: no part-*.parquet under machine=*/day=*")
    return counted


def open_history(folder, memory="1GB"):
    """A connection with the view `history`; `memory` bounds what DuckDB takes."""
    connection = duckdb.connect()
    connection.sql(f"set memory_limit = '{memory}'; set TimeZone = 'UTC'")
    held = ", ".join("'" + path.replace("'", "''") + "'" for path in files(folder))
    # Without types a machine named 0x10 would be the number 16, and one named inf a date.
    kinds = "hive_partitioning = true, hive_types = {'machine': VARCHAR, 'day': DATE}"
    connection.sql(f"create view history as select * from read_parquet([{held}], {kinds}, union_by_name = true)")
    return connection


def known(quantity):
    """The name of a figure's column, or an error that lists them."""
    if quantity not in QUANTITIES:
        raise ValueError(f"{quantity!r} is no quantity; one of: {', '.join(QUANTITIES)}")
    return quantity


def holds(connection, quantity):
    """Whether any file of the history has a figure's column: histories of former schemas lack some."""
    names = {name for name, *_ in connection.sql("describe history").fetchall()}
    return known(quantity) in names


def departures(connection, quantity="rms", days=7, limit=10):
    """Worst departures of the last days: each node's mean there against its own mean before, in standard deviations.

    Rows: machine, node, now, before, sigma, departure; the largest magnitude first. A node without a day before has none.
    """
    column = known(quantity)
    return connection.sql(f"""
        with hours as (
            select machine, node, date_trunc('hour', time) as hour, avg({column}) as value
            from history where {column} is not null and coalesce(validity, 'Locked') = 'Locked' group by all
        ), edge as (select max(hour) - to_seconds({float(days) * 86400}) as since from hours)
        select machine, node,
            avg(value) filter (hour > since) as now,
            avg(value) filter (hour <= since) as before,
            stddev_samp(value) filter (hour <= since) as sigma,
            (now - before) / nullif(sigma, 0) as departure
        from hours, edge group by machine, node having departure is not null
        order by abs(departure) desc limit {int(limit)}""")


def trend(connection, node, quantity="rms", speed_step=1.0):
    """A node's hourly means at like speed: hour, speed (middle of its step, Hz), value, rows."""
    column = known(quantity)
    return connection.execute(f"""
        select date_trunc('hour', time) as hour, (floor(speed_hz / ?) + 0.5) * ? as speed, avg({column}) as value, count(*) as rows
        from history where node = ? and {column} is not null and speed_hz is not null
        group by hour, speed order by hour, speed""", [speed_step, speed_step, node])


def drifting(connection, quantity="rms", speed_step=1.0, limit=10):
    """Machines that drift: slope of the hourly means at each node's most frequent speed, relative to their mean, per day.

    Rows: machine, node, speed, per_day (share of the mean), r2, hours; largest |per_day| with r2 above 0.3 first.
    """
    column = known(quantity)
    return connection.sql(f"""
        with hours as (
            select machine, node, (floor(speed_hz / {float(speed_step)}) + 0.5) * {float(speed_step)} as speed,
                epoch(date_trunc('hour', time)) / 86400 as day, avg({column}) as value
            from history where {column} is not null and speed_hz is not null group by all
        ), fits as (
            select machine, node, speed, count(*) as hours, regr_slope(value, day) / nullif(avg(value), 0) as per_day,
                regr_r2(value, day) as r2,
                row_number() over (partition by machine, node order by count(*) desc, speed) as rank
            from hours group by machine, node, speed
        )
        select machine, node, speed, per_day, r2, hours from fits
        where rank = 1 and r2 > 0.3 order by abs(per_day) desc limit {int(limit)}""")


def alarms(connection, limit=50):
    """Newest alarms: time, machine, node, event, detail."""
    return connection.sql(f"""
        select time, machine, node, event, detail from history
        where event in ('AlarmRaised', 'AlarmCleared', 'Acknowledged') order by time desc limit {int(limit)}""")


def overview(connection):
    """Every node: machine, node, unit, last seen, state, speed, newest RMS, velocity, kurtosis and FM4, frames, lost ones, alarms."""
    velocity = "null"
    if holds(connection, "velocity_rms"):
        velocity = "arg_max(velocity_rms, journal) filter (velocity_rms is not null)"
    return connection.sql(f"""
        select machine, node, arg_max(unit, journal) as unit, max(received) as seen,
            arg_max(state, journal) filter (state is not null) as state,
            arg_max(speed_hz, journal) filter (speed_hz is not null) as speed,
            arg_max(rms, journal) filter (rms is not null) as rms,
            {velocity} as velocity,
            arg_max(kurtosis, journal) filter (kurtosis is not null) as kurtosis,
            arg_max(fm4, journal) filter (fm4 is not null) as fm4,
            count(sequence) as frames,
            coalesce(sum(detail) filter (event = 'FramesLost'), 0) as lost,
            count(*) filter (event = 'AlarmRaised') as alarms
        from history where node <> '' group by machine, node order by machine, node""")
