"""The fleet page: static HTML from one command, an overview and a page per node; no server, nothing fetched."""

import datetime
import html
import pathlib
import urllib.parse

from . import lake

STYLE = """<meta charset="utf-8"><meta name="viewport" content="width=device-width"><style>
body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;color:#222;background:#fff}
table{border-collapse:collapse;width:100%}th,td{padding:.3em .7em;border-bottom:1px solid #ddd;text-align:right}
th:first-child,td:first-child,th:nth-child(2),td:nth-child(2){text-align:left}th{font-weight:600}
td:nth-child(-n+3){white-space:nowrap}
.warn{color:#a40000;font-weight:600}svg{width:100%;height:auto}figcaption{color:#555}a{color:#0645ad}
</style>"""

#: What a node's page shows, with its unit.
TRENDS = {"rms": ", m/s2", "velocity_rms": ", m/s", "kurtosis": "", "fm4": "", "mesh_1": ", m/s2"}


def text(value):
    """A cell: figures with four digits, instants to the second, nothing for nothing."""
    if value is None:
        return ""
    if isinstance(value, datetime.datetime):
        return f"{value:%Y-%m-%d %H:%M:%S}"
    return f"{value:.4g}" if isinstance(value, float) else html.escape(str(value))


def table(head, rows):
    cells = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>\n" for row in rows)
    return f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>"


def curve(points, label):
    """A line through (seconds, mean, least, most) as SVG in the band of the extremes, with their range written beside it."""
    if len(points) < 2:
        return f"<p>{html.escape(label)}: {len(points)} point, no trend yet</p>"
    times, values = [p[0] for p in points], [p[1] for p in points]
    low, high = min(p[2] for p in points), max(p[3] for p in points)
    span, width = (high - low) or 1.0, (times[-1] - times[0]) or 1.0
    place = lambda t, v: f"{10 + 980 * (t - times[0]) / width:.1f},{150 - 140 * (v - low) / span:.1f}"
    path = " ".join(place(t, v) for t, v in zip(times, values))
    band = " ".join([place(p[0], p[3]) for p in points] + [place(p[0], p[2]) for p in reversed(points)])
    return (
        f'<figure><svg viewBox="0 0 1000 160" role="img" aria-label="{html.escape(label)}">'
        f'<rect x="10" y="10" width="980" height="140" fill="none" stroke="#ddd"/>'
        f'<polygon points="{band}" fill="#cfe0fc"/>'
        f'<polyline points="{path}" fill="none" stroke="#0645ad" stroke-width="2"/></svg>'
        f"<figcaption>{html.escape(label)}: {low:.4g} to {high:.4g} (least and largest value)</figcaption></figure>"
    )


def file_name(node):
    return "node-" + urllib.parse.quote(node, safe="") + ".html"


def node_page(connection, row):
    """One node: who it is, trends at its most frequent speed, newest notes and events."""
    machine, node, unit, seen = row[:4]
    parts = [f"<title>{html.escape(node)}</title>{STYLE}<p><a href='index.html'>Fleet</a></p>"]
    parts.append(f"<h1>{html.escape(node)}</h1><p>Machine {html.escape(machine)}, chip {html.escape(unit)}, last seen {text(seen)} UTC</p>")
    for quantity, unit in ((name, unit) for name, unit in TRENDS.items() if lake.holds(connection, name)):
        speed, points = commonest(connection, node, quantity)
        if points:
            parts.append(curve(points, f"{quantity}{unit}, at {speed - 0.5:g} to {speed + 0.5:g} Hz"))
    events = connection.execute(
        """select time, kind, event, detail, text from history where node = ? and event is not null
           order by journal desc limit 40""", [node]).fetchall()
    parts.append("<h2>Newest events and notes</h2>")
    parts.append(table(["time (UTC)", "kind", "event", "detail", "text"], [[text(cell) for cell in event] for event in events]))
    return "\n".join(parts)


#: Points of a curve, about.
POINTS = 300


def commonest(connection, node, quantity):
    """The speed step with most rows, and its points (seconds, mean, least, most): about 300 from the first to the last.

    From the rollups' minutes where they reach back to the first hour, else from their hours; and from the rows they do not have.
    """
    column = lake.known(quantity)
    held = f"""select epoch(time) as instant, floor(speed_hz) + 0.5 as speed, {column} as value, {column} as least, {column} as most, 1 as rows
        from fresh where node = $1 and {column} is not null and {lake.LOCKED}"""
    level = finest(connection, node) if lake.has_rollup(connection) else "hour"
    if lake.has_rollup(connection, level, column):
        held += f""" union all select epoch(start), speed_class_hz, {column}_mean, {column}_min, {column}_max, {column}_count
            from rollup_{level} where node = $1 and {column}_count > 0 and speed_class_hz is not null"""
    rows = connection.execute(f"""
        with held as ({held}),
        best as (select speed from held group by speed order by sum(rows) desc, speed limit 1),
        width as (select greatest(1.0, (max(instant) - min(instant)) / {POINTS}) as width from held join best using (speed))
        select speed, floor(instant / width) * width as mean_at, sum(value * rows) / sum(rows), min(least), max(most)
        from held join best using (speed), width group by speed, mean_at order by mean_at""", [node]).fetchall()
    return (rows[0][0], [tuple(point) for _, *point in rows]) if rows else (None, [])


def finest(connection, node):
    """`minute` where a node's minutes reach back as far as its days, and a curve shows less than an hour a point; else `hour`."""
    span = "select min(start), max(start) from rollup_{} where node = ?"
    days, last = connection.execute(span.format("day"), [node]).fetchall()[0]
    if days is None or last - days > datetime.timedelta(hours=POINTS) or not lake.has_rollup(connection, "minute"):
        return "hour"
    minutes, _ = connection.execute(span.format("minute"), [node]).fetchall()[0]
    return "minute" if minutes is not None and minutes < days + datetime.timedelta(days=1) else "hour"


def write(history, folder, rollup=None):
    """Writes the pages; gives the overview's path."""
    connection = lake.open_history(history, rollup=rollup)
    out = pathlib.Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    overview = lake.overview(connection).fetchall()
    rows = []
    for row in overview:
        machine, node, unit, seen, state, speed, rms, velocity, kurtosis, fm4, frames, lost, alarms = row
        link = f"<a href='{file_name(node)}'>{html.escape(node)}</a>"
        marked = f"<span class='warn'>{alarms}</span>" if alarms else "0"
        gone = f"<span class='warn'>{lost}</span>" if lost else "0"
        cells = [text(machine), link, text(seen), text(state), text(speed), text(rms)]
        cells += [text(velocity and 1000 * velocity), text(kurtosis), text(fm4)]
        rows.append([*cells, str(frames), gone, marked])
        (out / file_name(node)).write_text(node_page(connection, row), encoding="utf-8")
    head = ["machine", "node", "last seen (UTC)", "state", "speed Hz", "RMS m/s2", "mm/s", "kurtosis", "FM4", "frames", "lost", "alarms"]
    worst = [[text(cell) for cell in row] for row in lake.departures(connection).fetchall()]
    drift = [[text(cell) for cell in row] for row in lake.drifting(connection).fetchall()]
    page = [f"<title>Fleet</title>{STYLE}<h1>Fleet</h1><p>{len(overview)} nodes</p>", table(head, rows)]
    page += ["<h2>Departures of the last 7 days from each node's own past (RMS)</h2>"]
    page += [table(["machine", "node", "now", "before", "sigma", "departure"], worst) if worst else "<p>No past to compare with yet.</p>"]
    page += ["<h2>Drift at the most frequent speed (RMS)</h2>"]
    page += [table(["machine", "node", "speed", "per day", "r2", "hours"], drift) if drift else "<p>None.</p>"]
    index = out / "index.html"
    index.write_text("\n".join(page), encoding="utf-8")
    return index
