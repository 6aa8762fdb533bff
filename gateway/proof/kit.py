"""What the proof and the fault tests share: a broker, a gateway, virtual nodes and a Sparkplug client, all on 127.0.0.1."""

import collections
import os
import pathlib
import random
import shutil
import signal
import socket
import subprocess
import threading
import time

import duckdb
import pysparkplug


def free_ports(count):
    """First of so many neighbouring ports that are free at present."""
    generator = random.Random()
    for _ in range(200):
        first = generator.randrange(20000, 60000 - count)
        held = []
        try:
            for port in range(first, first + count):
                held.append(socket.create_server(("127.0.0.1", port)))
            return first
        except OSError:
            continue
        finally:
            for server in held:
                server.close()
    raise SystemExit("no free ports on 127.0.0.1")


class Process:
    """A program with its output in a file; only this one is ever signalled."""

    def __init__(self, words, log):
        self.words, self.log, self.running = [str(word) for word in words], pathlib.Path(log), None

    def start(self):
        with self.log.open("ab") as log:
            self.running = subprocess.Popen(self.words, stdout=log, stderr=log, stdin=subprocess.DEVNULL)
        return self

    def kill(self):
        """SIGKILL: no chance to put anything in order."""
        self.running.kill()
        self.running.wait(300)

    def stop(self, patience=120):
        """SIGTERM, and the exit code; a machine that is busy otherwise takes its time."""
        if self.running and self.running.poll() is None:
            self.running.send_signal(signal.SIGTERM)
        return self.running.wait(patience) if self.running else None

    def wait(self, patience):
        return self.running.wait(patience)

    def used(self):
        """Processor seconds and peak resident megabytes of the running program."""
        process = pathlib.Path(f"/proc/{self.running.pid}")
        times = (process / "stat").read_text().rsplit(")", 1)[1].split()[11:13]
        peak = next(line for line in (process / "status").read_text().splitlines() if line.startswith("VmHWM:"))
        return sum(map(int, times)) / os.sysconf("SC_CLK_TCK"), int(peak.split()[1]) / 1024

    def text(self):
        return self.log.read_text(errors="replace")


class Broker(Process):
    """mosquitto on one local port; `password` makes it ask for user `gateway`, `tls` (from [`certificates`]) for TLS.

    `limits` leaves its own limits of what it holds for a subscriber as they are.
    """

    def __init__(self, folder, password=None, tls=None, limits=False):
        self.port = free_ports(1)
        program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")
        if program is None:
            raise SystemExit("mosquitto is not installed")
        lines = [
            f"listener {self.port} 127.0.0.1",
            "persistence false",
        ]
        if not limits:
            # A reader that is slow for a moment must not lose messages of which the proof then knows nothing.
            lines += ["max_queued_messages 0", "max_inflight_messages 0"]
        if password is None:
            lines.append("allow_anonymous true")
        else:
            passwords = folder / "passwords"
            subprocess.run(["mosquitto_passwd", "-b", "-c", passwords, "gateway", password], check=True)
            passwords.chmod(0o644)
            lines += ["allow_anonymous false", f"password_file {passwords}"]
        if tls:
            # Behind its listener, which is the last one named.
            lines += [f"certfile {tls}/broker.pem", f"keyfile {tls}/broker.key"]
            if (tls / "ca.pem").is_file():
                lines += [f"cafile {tls}/ca.pem", "require_certificate true"]
        config = folder / "mosquitto.conf"
        config.write_text("\n".join(lines) + "\n")
        folder.chmod(0o755)
        super().__init__([program, "-c", config], folder / "mosquitto.log")

    def start(self):
        """Comes back when it listens: a client that is earlier is refused."""
        said = lambda: self.text().count(" running") if self.log.exists() else 0
        before = said()
        super().start()
        until(lambda: said() > before, 60, "the broker listens")
        return self


def certificates(folder):
    """A certificate of its own for a broker on 127.0.0.1, signed by itself."""
    folder.mkdir()
    words = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"]
    words += ["-subj", "/CN=broker", "-addext", "subjectAltName=IP:127.0.0.1", "-addext", "basicConstraints=critical,CA:FALSE"]
    words += ["-keyout", folder / "broker.key", "-out", folder / "broker.pem"]
    subprocess.run(words, check=True, capture_output=True)
    # mosquitto gives up its rights before it reads them.
    (folder / "broker.key").chmod(0o644)
    return folder


def authority(folder):
    """An authority, and certificates that it signed: of a broker on 127.0.0.1, which then asks for one, and of two clients."""
    folder.mkdir()
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"]
    make = lambda *words: subprocess.run(["openssl", *words], check=True, capture_output=True)
    make("req", "-x509", *key, "-subj", "/CN=authority", "-keyout", folder / "ca.key", "-out", folder / "ca.pem")
    extensions = folder / "extensions"
    extensions.write_text("subjectAltName=IP:127.0.0.1\nbasicConstraints=critical,CA:FALSE\n")
    for name in ("broker", "gateway", "host"):
        request, out = folder / f"{name}.csr", folder / f"{name}.pem"
        make("req", *key[:-2], "-subj", f"/CN={name}", "-keyout", folder / f"{name}.key", "-out", request)
        signed = ["-CA", folder / "ca.pem", "-CAkey", folder / "ca.key", "-CAcreateserial", "-days", "2", "-extfile", extensions]
        make("x509", "-req", "-in", request, "-out", out, *signed)
        # mosquitto gives up its rights before it reads them.
        (folder / f"{name}.key").chmod(0o644)
    return folder


class Host:
    """An independent Sparkplug host application: counts what it reads with pysparkplug."""

    def __init__(self, port, tls=None, **login):
        self.messages = []
        self.kinds = collections.Counter()
        self.journals = collections.Counter()
        self.names = {}
        self.lock = threading.Lock()
        options = pysparkplug.ClientOptions(reconnection_delay_min=1, reconnection_delay_max=1)
        if tls and tls.is_dir():
            own = {"certfile": str(tls / "host.pem"), "keyfile": str(tls / "host.key")}
            login["transport_config"] = pysparkplug.TLSConfig(ca_certs=str(tls / "ca.pem"), **own)
        elif tls:
            login["transport_config"] = pysparkplug.TLSConfig(ca_certs=str(tls))
        self.client = pysparkplug.Client(client_id="host", client_options=options, **login)
        types = ["NBIRTH", "NDATA", "NDEATH", "DBIRTH", "DDATA", "DDEATH"]
        for kind in types:
            device = "+" if kind.startswith("D") else None
            topic = pysparkplug.Topic(
                message_type=pysparkplug.MessageType(kind), group_id="plant", edge_node_id="+", device_id=device
            )
            self.client.subscribe(topic, pysparkplug.QoS.AT_LEAST_ONCE, self.take)
        self.client.connect("127.0.0.1", port=port, callback=self.ask_for_births)

    def take(self, _client, message):
        with self.lock:
            kind = str(message.topic.message_type.value)
            self.kinds[kind] += 1
            held = getattr(message.payload, "metrics", ())
            if kind == "DBIRTH":
                self.names.update({metric.alias: metric.name for metric in held})
            metrics = {metric.name or self.names.get(metric.alias): metric.value for metric in held}
            if kind in ("DDATA", "NDATA") and "Frame/Journal" in metrics:
                self.journals[metrics["Frame/Journal"]] += 1
            elif kind == "DBIRTH" and metrics.get("Frame/Journal") is not None:
                # The entry that a node connected comes with its birth; a rebirth repeats the last one's number.
                self.journals.setdefault(metrics["Frame/Journal"], 1)
            if kind != "DDATA" or len(self.messages) < 20000:
                self.messages.append((kind, message.topic.device_id, metrics, message.payload))

    def ask_for_births(self, client):
        """A host application that was away knows no aliases: it asks the edge node for its births again."""
        now = pysparkplug.get_current_timestamp()
        truth = pysparkplug.DataType.BOOLEAN
        metric = pysparkplug.Metric(timestamp=now, name="Node Control/Rebirth", datatype=truth, value=True)
        topic = pysparkplug.Topic(
            message_type=pysparkplug.MessageType.NCMD, group_id="plant", edge_node_id="gateway-1"
        )
        payload = pysparkplug.NCmd(timestamp=now, metrics=(metric,))
        client.publish(
            pysparkplug.Message(topic=topic, payload=payload, qos=pysparkplug.QoS.AT_MOST_ONCE, retain=False),
            include_dtypes=True,
        )

    def command(self, edge, device, name, value, kind):
        metric = pysparkplug.Metric(
            timestamp=pysparkplug.get_current_timestamp(), name=name, datatype=kind, value=value
        )
        topic = pysparkplug.Topic(
            message_type=pysparkplug.MessageType.DCMD, group_id="plant", edge_node_id=edge, device_id=device
        )
        payload = pysparkplug.DCmd(timestamp=pysparkplug.get_current_timestamp(), metrics=(metric,))
        self.client.publish(
            pysparkplug.Message(topic=topic, payload=payload, qos=pysparkplug.QoS.AT_MOST_ONCE, retain=False),
            include_dtypes=True,
        )

    def state(self, name, online, stamp):
        """A host application's STATE, retained as it must be."""
        topic = pysparkplug.Topic(message_type=pysparkplug.MessageType.STATE, sparkplug_host_id=name)
        payload = pysparkplug.State(timestamp=stamp, online=online)
        message = pysparkplug.Message(topic=topic, payload=payload, qos=pysparkplug.QoS.AT_LEAST_ONCE, retain=True)
        self.client.publish(message)

    def close(self):
        self.client.disconnect()


def configure(folder, ports, broker=None, history=True, extra="", machines=5, name="gateway-1", node_extra=""):
    """A gateway's configuration file."""
    text = f'name = "{name}"\ndata = "{folder}/data"\n{extra}\n'
    if broker:
        text += f'[broker]\nhost = "127.0.0.1"\nport = {broker.port}\ngroup = "plant"\nretry_seconds = 1\n{broker.login}\n'
    if history:
        text += f'[history]\nfolder = "{folder}/history"\nflush_seconds = 2\ncompact_files = 8\n'
    for index, port in enumerate(ports):
        text += f'[[node]]\nname = "node-{index:02}"\nmachine = "machine-{index % machines}"\n'
        text += f'port = "tcp:127.0.0.1:{port}"\n{node_extra}\n'
    path = folder / "gateway.toml"
    path.write_text(text)
    return path


Broker.login = ""


def rows(folder, query):
    """A query on the view `history`."""
    connection = duckdb.connect()
    pattern = folder / "history" / "machine=*" / "day=*" / "part-*.parquet"
    connection.sql(
        f"create view history as select * from read_parquet('{pattern}', hive_partitioning = true, union_by_name = true)"
    )
    return connection.sql(query).fetchall()


def settled(folder, quiet=15, patience=600):
    """Waits until broker and history have taken what there is, and nothing came for a while."""
    places = lambda: [int((folder / f"data/{name}.cursor").read_text()) for name in ("broker", "history")]
    before, since, end = places(), time.monotonic(), time.monotonic() + patience
    while time.monotonic() < end and time.monotonic() < since + quiet:
        time.sleep(1)
        if (now := places()) != before or now[0] != now[1]:
            before, since = now, time.monotonic()


def stop_all(processes):
    """Ends every one of them, also where one does not end."""
    for process in processes:
        try:
            process.stop()
        except subprocess.TimeoutExpired:
            process.kill()


def until(condition, patience, what):
    """Waits until something holds."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if condition():
            return
        time.sleep(0.1)
    raise AssertionError(f"not within {patience} s: {what}")
