"""The Python part without gateway, broker or engine: `python -m unittest` in `gateway/python`."""

import datetime
import pathlib
import stat
import struct
import tempfile
import unittest

import pyarrow as pa
import pyarrow.parquet

from meshband_fleet import lake, local, page, records, verdicts

START = datetime.datetime(2026, 1, 1, tzinfo=datetime.timezone.utc)


def write(folder, first, count, machine="m", node="n", rms=lambda hour: 1.0):
    """A part with one row per hour."""
    times = [START + datetime.timedelta(hours=first + k) for k in range(count)]
    table = {name: pa.array([0.1] * count, pa.float32()) for name in (*lake.QUANTITIES, "speed_hz")}
    table |= {
        "rms": pa.array([rms(first + k) for k in range(count)], pa.float32()),
        "journal": pa.array(range(first, first + count), pa.uint64()),
        "received": pa.array(times, pa.timestamp("us", "UTC")),
        "time": pa.array(times, pa.timestamp("us", "UTC")),
        "node": pa.array([node] * count),
        "unit": pa.array(["00"] * count),
        "sequence": pa.array([k % 65536 for k in range(count)], pa.uint16()),
        "kind": pa.array(["indicators"] * count),
    }
    for name in ("state", "validity", "event", "text"):
        table[name] = pa.array([None] * count, pa.string())
    table["detail"] = pa.array([None] * count, pa.int64())
    partition = folder / f"machine={machine}" / "day=2026-01-01"
    partition.mkdir(parents=True, exist_ok=True)
    path = partition / f"part-{first:020}-{first + count - 1:020}.parquet"
    pyarrow.parquet.write_table(pa.table(table), path)
    return path


class Fleet(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def test_claim_a_merged_file_counts_once_while_its_parts_are_still_there(self):
        write(self.folder, 0, 10), write(self.folder, 10, 10), write(self.folder, 0, 20)
        count = lake.open_history(self.folder).sql("select count(*), count(distinct journal) from history").fetchall()
        self.assertEqual(count, [(20, 20)])

    def test_theory_departure_and_drift_are_those_put_in(self):
        write(self.folder, 0, 240, node="steady", rms=lambda hour: 1.0 + 0.01 * (hour % 2))
        write(self.folder, 0, 240, "drifts", "rising", rms=lambda hour: 1.0 + hour / 24 * 0.1)
        connection = lake.open_history(self.folder)
        (machine, node, speed, per_day, r2, hours), *others = lake.drifting(connection).fetchall()
        self.assertEqual((machine, node, hours, others), ("drifts", "rising", 240, []))
        mean = 1.0 + 239 / 2 / 24 * 0.1
        self.assertAlmostEqual(per_day, 0.1 / mean, places=5)
        self.assertAlmostEqual(r2, 1.0, places=5)
        worst = lake.departures(connection, days=2).fetchall()
        self.assertEqual(worst[0][1], "rising")
        now = sum(1.0 + hour / 24 * 0.1 for hour in range(192, 240)) / 48
        self.assertAlmostEqual(worst[0][2], now, places=4)

    def test_claim_the_page_has_every_node_and_escapes_names(self):
        write(self.folder / "history", 0, 3, node="a<b")
        index = page.write(self.folder / "history", self.folder / "page")
        self.assertIn("a&lt;b", index.read_text())
        self.assertTrue((self.folder / "page" / page.file_name("a<b")).is_file())

    def test_claim_a_trend_has_a_few_hundred_means_at_most_and_their_values(self):
        write(self.folder, 0, 2000, rms=lambda hour: hour // 1000)
        speed, points = page.commonest(lake.open_history(self.folder), "n", "rms")
        self.assertEqual(speed, 0.5)
        self.assertTrue(280 <= len(points) <= 302, len(points))
        self.assertEqual((points[0][1], points[-1][1]), (0.0, 1.0))

    def test_claim_a_history_of_a_former_schema_is_shown_without_what_it_lacks(self):
        path = write(self.folder / "history", 0, 3)
        held = pyarrow.parquet.read_table(path)
        new = page.write(self.folder / "history", self.folder / "page").read_text()
        self.assertIn("<td>100</td>", new, "0.1 m/s as mm/s")
        pyarrow.parquet.write_table(held.drop_columns(["velocity_rms", "gear_1"]), path)
        old = page.write(self.folder / "history", self.folder / "page").read_text()
        self.assertNotIn("<td>100</td>", old)
        self.assertIn("1 nodes", old)

    def test_fault_a_folder_without_history_is_named(self):
        with self.assertRaisesRegex(FileNotFoundError, "no part-"):
            lake.open_history(self.folder)
        with self.assertRaisesRegex(ValueError, "no quantity"):
            lake.known("drop table")


class Records(unittest.TestCase):
    setUp = Fleet.setUp

    def record(self, bits=16):
        """Two runs of two channels, one without a tach."""
        folder = self.folder / f"record-{bits}"
        folder.mkdir()
        kind, descr = ("h", "<i2") if bits == 16 else ("f", "<f4")
        runs = ""
        for number in range(2):
            header = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': (3, 2), }}".ljust(117).encode() + b"\n"
            values = struct.pack(f"<6{kind}", *(number + value for value in (1, -1, 2, -2, 3, -3)))
            (folder / f"run{number:02}.npy").write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + values)
            runs += f'[[run]]\nsignal = "run{number:02}.npy"\ninput_torque_n_m = {number}.5\n'
        (folder / "run01.tach.csv").write_text("edge_time_s\n0.25\n0.5\n")
        (folder / "record.toml").write_text(
            f'title = "t"\n[acquisition]\nsample_rate_hz = 100.0\nchannels = ["a", "b"]\nfull_scale_m_s2 = 65534.0\n'
            f'code_bits = {bits}\n{runs}tach = "run01.tach.csv"\n')
        return folder

    def test_theory_waveforms_are_codes_times_the_scale_channel_by_channel(self):
        for bits, scale in ((16, 2.0), (32, 1.0)):
            path = records.export(self.record(bits), self.folder / "lake")
            held = pyarrow.parquet.read_table(path)
            signals = [[1, 2, 3], [-1, -2, -3], [2, 3, 4], [0, -1, -2]]
            self.assertEqual(held.column("signal").to_pylist(), [[scale * value for value in signal] for signal in signals])
            self.assertEqual(held.column("channel").to_pylist(), ["a", "b", "a", "b"])
            self.assertEqual(held.column("tach_edges_s").to_pylist(), [None, None, [0.25, 0.5], None])
            self.assertEqual(held.column("input_torque_n_m").to_pylist(), [0.5, 0.5, 1.5, 1.5])
            self.assertEqual(held.schema.metadata[b"meshband.records"], b"1")

    def test_claim_a_record_is_written_once_and_a_changed_one_beside_it(self):
        record, lake_folder = self.record(), self.folder / "lake"
        first = records.export(record, lake_folder)
        written = first.stat().st_mtime_ns
        self.assertEqual(records.export(record, lake_folder), first)
        self.assertEqual(first.stat().st_mtime_ns, written)
        (record / "record.toml").write_text((record / "record.toml").read_text().replace('"t"', '"u"'))
        self.assertNotEqual(records.export(record, lake_folder), first)
        self.assertEqual(len(list(lake_folder.iterdir())), 2)

    def test_fault_a_damaged_record_leaves_nothing_and_is_named(self):
        record = self.record()
        (record / "run01.npy").write_bytes((record / "run01.npy").read_bytes()[:-1])
        with self.assertRaisesRegex(ValueError, "run01.npy: cut off"):
            records.export(record, self.folder / "lake")
        self.assertEqual(list((self.folder / "lake").iterdir()), [])


class Verdicts(unittest.TestCase):
    setUp = Fleet.setUp

    def program(self):
        """Stands in for the command: answers, refuses, hangs by the record's name, and counts its calls."""
        path = self.folder / "command"
        path.write_text(f"""#!/bin/sh
echo x >> {self.folder}/calls
case "$2" in *bad*) echo refused >&2; exit 2;; *slow*) exec sleep 5;; *killed*) kill -9 $$;; esac
printf '{{"b": 1, "a": "%s"}}' "$(basename "$2")" > "$4"; echo fine
""")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return str(path)

    def records(self):
        made = []
        for name in ("one", "bad", "slow", "killed", "two"):
            (self.folder / name).mkdir()
            (self.folder / name / "record.toml").write_text(name)
            made.append(str(self.folder / name))
        return [*made, str(self.folder / "absent")]

    def test_fault_one_bad_record_never_stops_a_job(self):
        records, options = self.records(), {"program": self.program(), "patience": 1.0}
        table = pa.Table.from_batches(verdicts.mapper(**options)([verdicts.batch(records)]))
        self.assertEqual(table.column("status").to_pylist(), ["ok", "failed", "timeout", "failed", "ok", "failed"])
        self.assertEqual(table.column("verdict").to_pylist()[0], '{"a":"one","b":1}')
        self.assertEqual(table.column("message").to_pylist()[1], "refused")
        pool = local.run(records, workers=2, **options)
        self.assertEqual(verdicts.same(table, pool), [], "whatever the partitioning")

    def test_claim_a_job_started_again_asks_only_what_has_no_answer_or_another_content(self):
        records, program, store = self.records()[:2], self.program(), str(self.folder / "store")
        run = lambda: pa.Table.from_batches(verdicts.mapper(program=program, store=store)([verdicts.batch(records)]))
        calls = lambda: len((self.folder / "calls").read_text().splitlines())
        first = run()
        self.assertEqual(calls(), 2)
        self.assertEqual(verdicts.same(first, run()), [])
        self.assertEqual(calls(), 2)
        (self.folder / "one" / "record.toml").write_text("changed")
        run()
        self.assertEqual(calls(), 3)


if __name__ == "__main__":
    unittest.main()
