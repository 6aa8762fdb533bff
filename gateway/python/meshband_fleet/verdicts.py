"""A function from Arrow batches of records to Arrow batches of verdicts, the same wherever it runs.

Each record is answered by the `meshband` command in a process of its own: a record that is refused, crashes the command or
outlasts its time gives a row that says so, and the job goes on. Answers are kept in a store, one file per record, command and
content; a job that is started again takes what is there. The order of rows inside a batch is the input's; between batches it is
the engine's, so results are compared sorted by record.
"""

import hashlib
import json
import os
import pathlib
import subprocess
import tempfile
import time

import pyarrow as pa

#: Columns of a verdict.
SCHEMA = pa.schema([
    ("record", pa.string()),
    ("content", pa.string()),
    ("command", pa.string()),
    ("status", pa.string()),
    ("exit_code", pa.int32()),
    ("message", pa.string()),
    ("verdict", pa.string()),
    ("seconds", pa.float64()),
])


def content(record):
    """SHA-256 over names and bytes of a record's files, 24 digits."""
    digest, root = hashlib.sha256(), pathlib.Path(record)
    if not root.is_dir():
        raise FileNotFoundError(f"{record}: no such folder")
    for path in sorted(p for p in root.rglob("*") if p.is_file()):
        digest.update(str(path.relative_to(root)).encode() + b"\0")
        with path.open("rb") as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
    return digest.hexdigest()[:24]


def ask(record, command, program, patience):
    """One record's row, from the command itself."""
    row = {"record": record, "command": " ".join(command), "verdict": None, "exit_code": None}
    begun = time.monotonic()
    try:
        row["content"] = content(record)
        with tempfile.TemporaryDirectory(prefix="meshband-verdict-") as folder:
            out = pathlib.Path(folder) / "verdict.json"
            # One thread per record: the engine's workers are the parallelism.
            environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
            words = [program, *command, record, "--json", str(out)]
            done = subprocess.run(
                words, capture_output=True, timeout=patience, stdin=subprocess.DEVNULL, env=environment, check=False
            )
            row["exit_code"] = done.returncode
            row["status"] = "ok" if done.returncode == 0 and out.is_file() else "failed"
            said = (done.stdout if row["status"] == "ok" else done.stderr).decode(errors="replace").strip().splitlines()
            row["message"] = said[0] if said else ""
            if out.is_file():
                row["verdict"] = json.dumps(json.loads(out.read_text()), sort_keys=True, separators=(",", ":"))
    except subprocess.TimeoutExpired:
        row.update(status="timeout", message=f"not within {patience} s")
    except (OSError, ValueError) as reason:
        row.update(status="failed", message=str(reason).splitlines()[0])
    row.setdefault("content", "")
    row["seconds"] = round(time.monotonic() - begun, 3)
    return row


def kept(store, row_name):
    """An answer kept before, if it is whole and final."""
    try:
        row = json.loads((store / row_name).read_text())
    except (OSError, ValueError):
        return None
    return row if row.get("status") in ("ok", "failed") and set(row) == set(SCHEMA.names) else None


def keep(store, row_name, row):
    """Keeps an answer: whole or not at all, however many workers write it."""
    handle, temporary = tempfile.mkstemp(dir=store, prefix=".new-")
    with os.fdopen(handle, "w") as file:
        json.dump(row, file)
    os.replace(temporary, store / row_name)


def answer(record, command, program="meshband", store=None, patience=600.0):
    """One record's row, from the store where it is there."""
    if store is None:
        return ask(record, command, program, patience)
    folder = pathlib.Path(store)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        mark = content(record)
    except OSError:
        mark = "unreadable"
    name = hashlib.sha256(json.dumps([record, mark, list(command)]).encode()).hexdigest()[:32] + ".json"
    row = kept(folder, name)
    if row is None:
        row = ask(record, command, program, patience)
        keep(folder, name, row)
    return row


def mapper(command=("loop",), **options):
    """The function from batches (column `record`: folder) to batches of [`SCHEMA`], for `mapInArrow` and its like."""

    def over(batches):
        for batch in batches:
            rows = [answer(record.as_py(), tuple(command), **options) for record in batch.column("record")]
            yield pa.RecordBatch.from_pylist(rows, schema=SCHEMA)

    return over


def batch(records):
    """One batch of records."""
    return pa.RecordBatch.from_pydict({"record": [str(record) for record in records]})


def same(left, right):
    """What differs between two tables of verdicts, sorted by record and without the times; empty where nothing does."""
    names = [name for name in SCHEMA.names if name != "seconds"]
    tables = [sorted(t.select(names).to_pylist(), key=lambda row: row["record"]) for t in (left, right)]
    if len(tables[0]) != len(tables[1]):
        return [f"{len(tables[0])} rows and {len(tables[1])}"]
    return [a["record"] for a, b in zip(*tables) if a != b]
