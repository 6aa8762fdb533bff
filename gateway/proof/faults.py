"""What the gateway does when something around it is wrong: each outcome, defined in book/src/howto/fleet.md.

MESHBAND_GATEWAY names the program; `python -m unittest` in this folder.
"""

import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import time
import unittest
import urllib.request

import pysparkplug

import kit

GATEWAY = os.environ["MESHBAND_GATEWAY"]


class Fault(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="meshband-fault-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def started(self, process):
        process.start()
        self.addCleanup(process.stop)
        return process

    def nodes(self, count, port=None, unit=1):
        port = port or kit.free_ports(count)
        words = [GATEWAY, "nodes", "--count", count, "--port", port, "--unit", unit]
        self.started(process := kit.Process(words, self.folder / f"nodes-{unit}.log"))
        kit.until(lambda: "nodes on" in process.text(), 10, "nodes listen")
        return process, port

    def gateway(self, config, name="gateway"):
        return self.started(kit.Process([GATEWAY, config], self.folder / f"{name}.log"))

    def events(self):
        try:
            return {row[0] for row in kit.rows(self.folder, "select distinct event from history where event is not null")}
        except Exception as reason:  # the first file is not there yet
            if "No files found" in str(reason):
                return set()
            raise

    def test_fault_wrong_credentials_are_said_once_and_the_history_goes_on(self):
        broker = self.started(kit.Broker(self.folder, password="right"))
        (self.folder / "secret").write_text("wrong\n")
        broker.login = f'user = "gateway"\npassword_file = "{self.folder}/secret"'
        _, port = self.nodes(1)
        metrics = kit.free_ports(1)
        config = kit.configure(self.folder, [port], broker, extra=f'metrics = "127.0.0.1:{metrics}"')
        gateway = self.gateway(config)
        kit.until(lambda: "Connected" in self.events(), 20, "history in spite of the broker")
        lines = [line for line in gateway.text().splitlines() if line.startswith("broker")]
        self.assertEqual(len(lines), 1, gateway.text())
        page = urllib.request.urlopen(f"http://127.0.0.1:{metrics}/metrics", timeout=5).read().decode()
        self.assertIn("meshband_broker_connected 0\n", page)
        self.assertRegex(page, r"meshband_broker_refusals_total [1-9]")
        # The right password in the file is taken without a restart, and nothing was lost meanwhile.
        (self.folder / "secret").write_text("right\n")
        host = kit.Host(broker.port, username="gateway", password="right")
        self.addCleanup(host.close)
        kit.until(lambda: 0 in host.journals, 20, "the first entry of all at the broker")

    @unittest.skipUnless(shutil.which("openssl"), "openssl makes the certificates")
    def test_fault_tls_takes_the_certificate_that_is_vouched_for_and_no_other(self):
        own, strange = kit.certificates(self.folder / "own"), kit.certificates(self.folder / "strange")
        broker = self.started(kit.Broker(self.folder, tls=own))
        vouches = self.folder / "ca.pem"
        shutil.copy(strange / "broker.pem", vouches)
        broker.login = f'tls_ca = "{vouches}"'
        _, port = self.nodes(1)
        gateway = self.gateway(kit.configure(self.folder, [port], broker))
        kit.until(lambda: "Connected" in self.events(), 20, "history in spite of the broker")
        lines = [line for line in gateway.text().splitlines() if line.startswith("broker")]
        self.assertEqual(len(lines), 1, gateway.text())
        self.assertIn("certificate", lines[0].lower())
        # The right certificate in the file is taken without a restart, and nothing was lost meanwhile.
        shutil.copy(own / "broker.pem", vouches)
        host = kit.Host(broker.port, tls=own / "broker.pem")
        self.addCleanup(host.close)
        kit.until(lambda: 0 in host.journals, 20, "the first entry of all at the broker")

    @unittest.skipUnless(shutil.which("openssl"), "openssl makes the certificates")
    def test_fault_a_broker_that_asks_for_a_certificate_takes_the_one_its_authority_signed(self):
        own, strange = kit.authority(self.folder / "own"), kit.authority(self.folder / "strange")
        broker = self.started(kit.Broker(self.folder, tls=own))
        for name in ("gateway.pem", "gateway.key"):
            shutil.copy(strange / name, self.folder / name)
        broker.login = f'tls_ca = "{own}/ca.pem"\ntls_cert = "{self.folder}/gateway.pem"\ntls_key = "{self.folder}/gateway.key"'
        _, port = self.nodes(1)
        gateway = self.gateway(kit.configure(self.folder, [port], broker))
        kit.until(lambda: "Connected" in self.events(), 20, "history in spite of the broker")
        kit.until(lambda: any(line.startswith("broker") for line in gateway.text().splitlines()), 20, "the refusal is said")
        self.assertNotIn("connected, ", gateway.text(), "a certificate of another authority")
        # The right certificate and key are taken without a restart, and nothing was lost meanwhile.
        for name in ("gateway.pem", "gateway.key"):
            shutil.copy(own / name, self.folder / name)
        host = kit.Host(broker.port, tls=own)
        self.addCleanup(host.close)
        kit.until(lambda: 0 in host.journals, 30, "the first entry of all at the broker")

    def test_fault_a_full_disk_loses_and_counts_and_goes_on(self):
        mount = self.folder / "small"
        mount.mkdir()
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=9m", "tmpfs", mount], capture_output=True, check=False)
        if done.returncode != 0:
            self.skipTest("no right to mount a small disk here")
        self.addCleanup(subprocess.run, ["umount", "-l", mount], check=False)
        _, port = self.nodes(1)
        config = kit.configure(self.folder, [port])
        config.write_text(config.read_text().replace(f"{self.folder}/data", f"{mount}/data"))
        ballast = mount / "ballast"
        gateway = self.gateway(config)
        kit.until(lambda: "Connected" in self.events(), 20, "running")
        handle = os.open(ballast, os.O_WRONLY | os.O_CREAT)
        for size in (4096, 1):
            try:
                while True:
                    os.write(handle, bytes(size))
            except OSError:
                pass
        os.close(handle)
        kit.until(lambda: "frames are lost until there is room" in gateway.text(), 30, "said")
        self.assertIsNone(gateway.running.poll(), "it goes on")
        ballast.unlink()
        kit.until(lambda: "EntriesLost" in self.events(), 30, "the loss is in the history")
        lost = kit.rows(self.folder, "select sum(detail) from history where event = 'EntriesLost'")[0][0]
        self.assertGreater(lost, 0)
        self.assertIn(f"{lost} entries were lost", gateway.text())

    def test_fault_a_replaced_node_is_another_chip_under_the_same_name(self):
        first, port = self.nodes(1)
        gateway = self.gateway(kit.configure(self.folder, [port]))
        kit.until(lambda: "Connected" in self.events(), 20, "the first node")
        first.stop()
        self.nodes(1, port, unit=77)
        kit.until(lambda: "Replaced" in self.events(), 30, "the second one is seen as another")
        units = kit.rows(self.folder, "select unit, min(boot), max(boot) from history where sequence is not null group by 1 order by 2")
        self.assertEqual(len(units), 2)
        self.assertLess(units[0][2], units[1][1], "counts of starts do not overlap")
        gateway.stop()

    def test_fault_a_node_that_goes_away_dies_at_the_broker_and_is_born_again(self):
        broker = self.started(kit.Broker(self.folder))
        nodes, port = self.nodes(1)
        host = kit.Host(broker.port)
        self.addCleanup(host.close)
        self.gateway(kit.configure(self.folder, [port], broker))
        kit.until(lambda: host.kinds["DBIRTH"] > 0 and host.kinds["DDATA"] > 5, 30, "born, with data")
        nodes.stop()
        kit.until(lambda: host.kinds["DDEATH"] == 1, 20, "dead")
        births = host.kinds["DBIRTH"]
        self.nodes(1, port)
        kit.until(lambda: host.kinds["DBIRTH"] > births, 30, "born again")
        kit.until(lambda: {"Connected", "Disconnected"} <= self.events(), 20, "both are in the history")

    def test_claim_a_host_with_one_alias_table_sees_one_birth_of_each_node_and_no_alias_twice(self):
        broker = self.started(kit.Broker(self.folder))
        host = kit.Host(broker.port)
        self.addCleanup(host.close)
        first, second = kit.free_ports(1), kit.free_ports(1)
        self.gateway(kit.configure(self.folder, [first, second], broker))
        kit.until(lambda: host.kinds["NBIRTH"] > 0, 20, "the edge node is born")
        # The host's own request for births is over before the nodes are there.
        for unit, port in ((1, first), (50, second)):
            self.nodes(1, port, unit)
        kit.until(lambda: len({device for kind, device, _, _ in host.messages if kind == "DDATA"}) == 2, 30, "data of both")
        births = [(device, payload) for kind, device, _, payload in list(host.messages) if kind == "DBIRTH"]
        self.assertEqual(sorted(device for device, _ in births), ["node-00", "node-01"])
        aliases = [metric.alias for _, payload in births for metric in payload.metrics]
        self.assertEqual(len(aliases), len(set(aliases)))

    def test_claim_nothing_is_published_while_the_primary_host_is_offline_and_nothing_is_lost(self):
        broker = self.started(kit.Broker(self.folder))
        broker.login = 'primary_host = "scada"'
        host = kit.Host(broker.port)
        self.addCleanup(host.close)
        state = lambda online, stamp: host.state("scada", online, stamp)
        state(False, 1000)
        _, port = self.nodes(1)
        gateway = self.gateway(kit.configure(self.folder, [port], broker))
        kit.until(lambda: "Connected" in self.events(), 20, "history without the host")
        self.assertEqual(dict(host.kinds), {}, "no birth, no data")
        state(True, 2000)
        kit.until(lambda: host.kinds["DDATA"] > 5, 20, "born, with data")
        state(False, 1999)
        before = host.kinds["DDATA"]
        kit.until(lambda: host.kinds["DDATA"] > before, 20, "an offline of the past changes nothing")
        self.assertEqual(host.kinds["NDEATH"], 0)
        state(False, 2000)
        kit.until(lambda: host.kinds["NDEATH"] == 1, 20, "dead")
        births, silent = host.kinds["NBIRTH"], host.kinds["DDATA"]
        kit.until(lambda: gateway.text().count("connected, ") == 2, 20, "connected again, and waiting")
        rows = lambda: kit.rows(self.folder, "select count(*) from history")[0][0]
        waiting = rows()
        kit.until(lambda: rows() > waiting, 20, "the history goes on")
        self.assertEqual((host.kinds["NBIRTH"], host.kinds["DDATA"]), (births, silent))
        state(True, 3000)
        kit.until(lambda: host.kinds["NBIRTH"] == births + 1, 20, "born again")
        most = kit.rows(self.folder, "select max(journal) from history")[0][0]
        kit.until(lambda: set(range(most + 1)) <= set(host.journals), 20, "every entry at the host")

    def test_claim_days_that_are_over_are_rolled_up_and_thinned_by_rule_and_the_history_goes_on(self):
        _, port = self.nodes(1)
        config = kit.configure(self.folder, [port])
        first = self.gateway(config)
        query = "select count(*), min(rms), max(rms) from history where rms is not null"
        kit.until(lambda: "Connected" in self.events() and kit.rows(self.folder, query)[0][0] > 3, 30, "values")
        first.stop()
        held = kit.rows(self.folder, query)[0]
        # As if it had been in January.
        day = next((self.folder / "history").glob("machine=machine-0/day=*"))
        day.rename(day.with_name("day=2026-01-01"))
        config.write_text(config.read_text() + "[history.rollup]\nraw_days = 1\n")
        second = self.gateway(config, "second")
        rollup = self.folder / "history-rollup"
        kit.until(lambda: "1 machine days rolled up, 1 thinned" in second.text(), 30, "said")
        self.assertEqual(json.loads((rollup / "_units.jsonl").read_text())["day"], "2026-01-01")
        self.assertFalse((self.folder / "history/machine=machine-0/day=2026-01-01").exists())
        folder = f"'{rollup}/level=hour/**/*.parquet'"
        rolled = kit.duckdb.sql(f"select sum(rms_count)::bigint, min(rms_min), max(rms_max) from {folder}").fetchall()[0]
        self.assertEqual(rolled, held)
        kit.until(lambda: kit.rows(self.folder, query)[0][0] > 3, 30, "the history goes on")

    def test_fault_a_node_that_is_not_the_configured_chip_is_refused(self):
        _, port = self.nodes(1, unit=5)
        wanted = "000000096d6573686261" + "6e64"
        config = kit.configure(self.folder, [port], node_extra=f'unit = "{wanted}"')
        gateway = self.gateway(config)
        kit.until(lambda: "is configured: not taken" in gateway.text(), 20, "refused")
        time.sleep(3)
        self.assertEqual(self.events(), set(), "nothing of it is kept")

    def test_fault_two_gateways_for_one_node_and_for_one_folder(self):
        _, port = self.nodes(1)
        config = kit.configure(self.folder, [port])
        first = self.gateway(config)
        kit.until(lambda: "Connected" in self.events(), 20, "the first gateway")
        second = self.gateway(config, "same-folder")
        self.assertEqual(second.wait(10), 2)
        self.assertIn("another gateway works in this folder", second.text())
        other = self.folder / "other"
        other.mkdir()
        third = self.gateway(kit.configure(other, [port], name="gateway-2"), "other-folder")
        kit.until(lambda: "is another gateway on it?" in third.text(), 20, "the node has one line")
        self.assertIsNone(first.running.poll())
        self.assertNotIn("Disconnected", self.events(), "the first one is not disturbed")

    def test_fault_two_gateways_of_one_name_take_the_session_from_each_other_and_both_histories_go_on(self):
        broker = self.started(kit.Broker(self.folder))
        first_port, second_port = kit.free_ports(1), kit.free_ports(1)
        self.nodes(1, first_port)
        self.nodes(1, second_port, unit=50)
        first = self.gateway(kit.configure(self.folder, [first_port], broker))
        kit.until(lambda: "connected" in first.text(), 20, "the first gateway")
        other = self.folder / "other"
        other.mkdir()
        second = self.gateway(kit.configure(other, [second_port], broker), "second")
        sessions = lambda gateway: gateway.text().count("connected, ")
        kit.until(lambda: sessions(first) >= 2 and sessions(second) >= 2, 60, "each takes it over again")
        for folder in (self.folder, other):
            count = lambda folder=folder: kit.rows(folder, "select count(*), count(distinct journal) from history")[0]
            kit.until(lambda folder=folder: any(folder.glob("history/*/*/part-*")), 20, "a first file")
            before = count()[0]
            kit.until(lambda: count()[0] > before, 20, "the history goes on")
            rows, distinct = count()
            self.assertEqual(rows, distinct)

    def test_claim_commands_of_a_host_application_reach_the_node(self):
        broker = self.started(kit.Broker(self.folder))
        _, port = self.nodes(1)
        time.sleep(0.5)
        host = kit.Host(broker.port)
        self.addCleanup(host.close)
        self.gateway(kit.configure(self.folder, [port], broker))
        seen = lambda name, value: any(metrics.get(name) == value for _, _, metrics, _ in host.messages)
        kit.until(lambda: host.kinds["DBIRTH"] > 0 and seen("Node/State", "Measuring"), 30, "born and measuring")
        truth = pysparkplug.DataType.BOOLEAN
        host.command("gateway-1", "node-00", "Command/Snapshot", True, truth)
        kit.until(lambda: seen("Frame/Kind", "snapshot"), 20, "a waveform")
        host.command("gateway-1", "node-00", "Command/Acknowledge", True, truth)
        kit.until(lambda: seen("Event/Kind", "AlarmsAcknowledged"), 20, "acknowledged, says the node itself")
        host.command("gateway-1", "node-00", "Command/Stop", True, truth)
        # A stopped node says nothing by itself; the gateway asks it who it is, and does not take it for gone.
        kit.until(lambda: host.messages and host.messages[-1][2].get("Frame/Kind") == "identity", 30, "stopped, and there")
        self.assertEqual(host.kinds["DDEATH"], 0)
        host.messages.clear()
        host.command("gateway-1", "node-00", "Command/Start", True, truth)
        kit.until(lambda: seen("Frame/Kind", "status"), 20, "started")
        host.command("gateway-1", "node-00", "Command/Configure", "{}", pysparkplug.DataType.STRING)
        kit.until(lambda: "Command" in self.events(), 20, "commands are in the history")
        text = lambda: {row[0] for row in kit.rows(self.folder, "select text from history where event = 'Command'")}
        kit.until(lambda: any("allow_configure is not set" in t for t in text()), 20, "the switch is off")
        births = [payload for kind, _, _, payload in host.messages if kind == "DBIRTH"]
        self.assertTrue(all(metric.alias is not None for birth in births for metric in birth.metrics))

    def test_fault_mistakes_in_the_file_end_in_one_line_and_code_2(self):
        config = kit.configure(self.folder, [7700])
        text = config.read_text()
        for mistake, says in [
            (text.replace("flush_seconds", "flush_second"), "unknown field"),
            (text.replace("machine-0", "../etc"), "node.machine"),
            (text.replace("[[node]]", "[[nodes]]"), "unknown field"),
            ("name = ", "gateway.toml"),
        ]:
            config.write_text(mistake)
            done = subprocess.run([GATEWAY, config], capture_output=True, text=True, timeout=20, check=False)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
            self.assertIn(says, done.stderr)


if __name__ == "__main__":
    unittest.main()
