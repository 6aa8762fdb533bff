"""What subscribers get of a gateway behind mosquitto with its own limits: prompt, slow, away, each with its quality of service.

A message is a DDATA or NDATA payload, told apart by its bytes; each has the number of its entry. What any subscriber got, and what the
broker acknowledged to the gateway, is what was published. mosquitto holds 20 messages on their way and 1000 behind them for each
subscriber and drops the rest; the gateway learns nothing of it.
"""

import argparse
import json
import pathlib
import tempfile
import threading
import time

import paho.mqtt.client as paho

import kit

#: Seconds that a slow subscriber takes for a message: 50 nodes send three times as many as it reads.
SLOW_S = 0.02
#: Share of the time for which a subscriber is away, in the middle of it.
AWAY = 0.5


class Subscriber:
    """Keeps a fingerprint of every message of data."""

    def __init__(self, port, name, qos, delay=0.0, persistent=False):
        self.port, self.name, self.qos, self.delay, self.persistent = port, name, qos, delay, persistent
        self.seen, self.again, self.lock = set(), 0, threading.Lock()
        self.client = paho.Client(client_id=name, clean_session=not persistent)
        self.client.on_connect = lambda client, *_: client.subscribe("spBv1.0/#", qos)
        self.client.on_message = self.take
        self.back()

    def take(self, _client, _held, message):
        if "/DDATA/" not in message.topic and "/NDATA/" not in message.topic:
            return
        with self.lock:
            mark = hash(message.payload)
            self.again += mark in self.seen
            self.seen.add(mark)
        time.sleep(self.delay)

    def back(self):
        self.client.connect("127.0.0.1", self.port)
        self.client.loop_start()

    def away(self):
        self.client.disconnect()
        self.client.loop_stop()


def run(arguments, folder):
    broker = kit.Broker(folder, limits=True)
    broker.start()
    subscribers = [
        Subscriber(broker.port, "prompt, QoS 1", 1),
        Subscriber(broker.port, "prompt, QoS 0", 0),
        Subscriber(broker.port, "slow, QoS 1", 1, SLOW_S),
        Subscriber(broker.port, "slow, QoS 0", 0, SLOW_S),
        Subscriber(broker.port, "away, QoS 1, persistent", 1, persistent=True),
        Subscriber(broker.port, "away, QoS 1, not persistent", 1),
    ]
    first = kit.free_ports(arguments.nodes)
    words = [arguments.gateway, "nodes", "--count", arguments.nodes, "--port", first, "--seconds", arguments.seconds]
    nodes = kit.Process(words, folder / "nodes.log").start()
    config = kit.configure(folder, range(first, first + arguments.nodes), broker)
    gateway = kit.Process([arguments.gateway, config], folder / "gateway.log").start()
    away = [subscriber for subscriber in subscribers if subscriber.name.startswith("away")]
    try:
        time.sleep(arguments.seconds * (1 - AWAY) / 2)
        for subscriber in away:
            subscriber.away()
        time.sleep(arguments.seconds * AWAY)
        for subscriber in away:
            subscriber.back()
        nodes.wait(600)
        kit.settled(folder)
        code = gateway.stop()
        drain(subscribers)
    finally:
        for subscriber in subscribers:
            subscriber.away()
        kit.stop_all((gateway, nodes, broker))
    return count(arguments, folder, subscribers, code)


def drain(subscribers):
    """Until no subscriber gets any more: the slow ones have a backlog in the broker and in sockets."""
    before = None
    while (now := [len(subscriber.seen) for subscriber in subscribers]) != before:
        before = now
        time.sleep(2)


def count(arguments, folder, subscribers, code):
    published = set().union(*(subscriber.seen for subscriber in subscribers))
    entries, distinct, most = kit.rows(folder, "select count(*), count(distinct journal), max(journal) + 1 from history")[0]
    acknowledged = int((folder / "data/broker.cursor").read_text())
    births = kit.rows(folder, "select count(*) from history where event = 'Connected'")[0][0]
    return {
        "nodes": arguments.nodes,
        "seconds": arguments.seconds,
        "seconds away": arguments.seconds * AWAY,
        "journal entries": most,
        "in Parquet, distinct": [entries, distinct],
        "acknowledged by the broker": acknowledged,
        "of which in births": births,
        "for the next session, written at the stop": most - acknowledged,
        "messages of data that any subscriber got": len(published),
        "got, share, got twice": {
            subscriber.name: [len(subscriber.seen), round(len(subscriber.seen) / len(published), 4), subscriber.again]
            for subscriber in subscribers
        },
        "gateway's exit code": code,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gateway", type=pathlib.Path, help="the meshband-gateway program")
    parser.add_argument("--nodes", type=int, default=50)
    parser.add_argument("--seconds", type=int, default=120)
    parser.add_argument("--json", type=pathlib.Path, help="where the figures go")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="meshband-subscribers-") as temporary:
        result = run(arguments, pathlib.Path(temporary))
    text = json.dumps(result, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    stored = result["in Parquet, distinct"] == [result["journal entries"]] * 2
    published = result["messages of data that any subscriber got"]
    prompt = result["got, share, got twice"]["prompt, QoS 1"][0]
    if not stored or prompt != published or published + result["of which in births"] < result["acknowledged by the broker"]:
        raise SystemExit("the claim does not hold: every entry once in Parquet, every acknowledged one at a prompt subscriber of QoS 1")


if __name__ == "__main__":
    main()
