"""Proof: many nodes through one gateway, broker and gateway killed, every frame exactly once in the history.

What every node sent is its own ledger (sequence and fingerprint per frame, written by the node program); what arrived is counted
by DuckDB in the Parquet files, and by an independent Sparkplug client at the broker.
"""

import argparse
import csv
import json
import os
import pathlib
import random
import tempfile
import time

import kit


def run(arguments, folder):
    first = kit.free_ports(arguments.nodes)
    ports = range(first, first + arguments.nodes)
    ledger = folder / "ledger.csv"
    words = [arguments.gateway, "nodes", "--count", arguments.nodes, "--port", first, "--ledger", ledger]
    words += ["--repeat", arguments.repeat, "--seconds", arguments.seconds]
    broker = kit.Broker(folder)
    broker.start()
    time.sleep(0.5)
    host = kit.Host(broker.port)
    nodes = kit.Process(words, folder / "nodes.log").start()
    config = kit.configure(folder, ports, broker)
    gateway = kit.Process([arguments.gateway, config], folder / "gateway.log").start()
    kills = schedule(arguments)
    start, used = time.monotonic(), []
    try:
        for at, what in kills:
            time.sleep(max(0.0, start + at - time.monotonic()))
            victim = broker if what == "broker" else gateway
            if victim is gateway:
                used.append(gateway.used())
            victim.kill()
            time.sleep(random.Random(at).uniform(0.5, 3.0))
            victim.start()
        time.sleep(max(0.0, start + arguments.seconds - time.monotonic()))
        # All that waits goes out before the end; on a machine that is busy otherwise it waits in sockets, too.
        nodes.wait(600)
        kit.settled(folder)
        used.append(gateway.used())
        code = gateway.stop()
        time.sleep(1)
        host.close()
    finally:
        kit.stop_all((gateway, nodes, broker))
    cost = {
        "gateway's processor seconds": round(sum(seconds for seconds, _ in used), 1),
        "gateway's peak memory, MB": round(max(peak for _, peak in used)),
        "load of the last 15 minutes at the end": round(os.getloadavg()[2], 1),
    }
    return {**count(folder, ledger, host, kills, code, arguments), **cost}


def schedule(arguments):
    """Kills at seeded instants between the first and the last tenth."""
    generator = random.Random(arguments.seed)
    kinds = ["broker"] * arguments.broker_kills + ["gateway"] * arguments.gateway_kills
    generator.shuffle(kinds)
    span, length = 0.8 * arguments.seconds, len(kinds)
    return [(0.1 * arguments.seconds + span * (place + 0.5) / length, kind) for place, kind in enumerate(kinds)]


def count(folder, ledger, host, kills, code, arguments):
    with ledger.open() as file:
        sent = [(int(row["node"]), int(row["sequence"])) for row in csv.DictReader(file) if row["delivered"] == "1"]
    held = kit.rows(
        folder, "select cast(substr(node, 6) as int), sequence, count(*) from history where sequence is not null group by all"
    )
    times = {(node, sequence): number for node, sequence, number in held}
    numbers = kit.rows(folder, "select count(*), count(distinct journal), max(journal) + 1 from history")[0]
    notes = kit.rows(folder, "select event, count(*), sum(detail) from history where kind = 'note' group by 1 order by 1")
    files = list((folder / "history").glob("machine=*/day=*/*"))
    return {
        "nodes": arguments.nodes,
        "seconds": arguments.seconds,
        "seed": arguments.seed,
        "broker killed": sum(kind == "broker" for _, kind in kills),
        "gateway killed": sum(kind == "gateway" for _, kind in kills),
        "frames repeated by a node after a break": arguments.repeat,
        "frames sent": len(sent),
        "frames in Parquet": sum(times.values()),
        "missing in Parquet": len(set(sent) - set(times)),
        "more than once in Parquet": sum(number > 1 for number in times.values()),
        "not sent and in Parquet": len(set(times) - set(sent)),
        "journal entries": numbers[2],
        "journal entries in Parquet": numbers[0],
        "distinct journal entries in Parquet": numbers[1],
        "notes": {event: [int(number), int(detail)] for event, number, detail in notes},
        "Parquet files": len(files),
        "Parquet bytes": sum(path.stat().st_size for path in files),
        "Sparkplug messages": dict(sorted(host.kinds.items())),
        "entries seen by the Sparkplug client": len(host.journals),
        "entries it saw again": sum(host.journals.values()) - len(host.journals),
        "gateway's exit code": code,
    }


def holds(result):
    """The claim: each frame once, in files that all can be read; births, data and deaths seen by another's client."""
    once = all(result[name] == 0 for name in ("missing in Parquet", "more than once in Parquet", "not sent and in Parquet"))
    whole = result["journal entries"] == result["journal entries in Parquet"] == result["distinct journal entries in Parquet"]
    seen = all(result["Sparkplug messages"].get(kind, 0) > 0 for kind in ("NBIRTH", "DBIRTH", "DDATA", "NDEATH"))
    return once and whole and seen and result["frames sent"] > 0 and result["gateway's exit code"] == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gateway", type=pathlib.Path, help="the meshband-gateway program")
    parser.add_argument("--nodes", type=int, default=50)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--broker-kills", type=int, default=5)
    parser.add_argument("--gateway-kills", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=256)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=pathlib.Path, help="where the figures go")
    parser.add_argument("--keep", type=pathlib.Path, help="folder to work in, kept afterwards")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="meshband-gateway-") as temporary:
        folder = arguments.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        result = run(arguments, folder)
    text = json.dumps(result, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    if not holds(result):
        raise SystemExit("the claim does not hold: see the figures above")


if __name__ == "__main__":
    main()
