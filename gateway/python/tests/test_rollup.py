"""Questions of a history whose raw rows are rolled up, and mostly gone, have the answers that all raw rows gave."""

import json
import shutil
import unittest

import duckdb

from meshband_fleet import lake, page
import test_fleet

#: First day of the file that holds a day's buckets.
SPANS = {"minute": "2026-01-01", "hour": "2026-01-01", "day": "2026-01-01"}


def roll(history, rollup, unit, last, machine="m"):
    """Buckets of a machine's raw rows, as the gateway writes them, and the line of their unit; rows behind `last` are not in it."""
    raw = f"read_parquet('{history}/machine={machine}/*/*.parquet')"
    for level, day in SPANS.items():
        partition = rollup / f"level={level}" / f"machine={machine}" / f"day={day}"
        partition.mkdir(parents=True, exist_ok=True)
        figures = ", ".join(
            f"min({q}) as {q}_min, max({q}) as {q}_max, avg({q})::float as {q}_mean, count({q})::int as {q}_count" for q in lake.QUANTITIES)
        duckdb.sql(f"""copy (select node, date_trunc('{level}', time) as start, (floor(speed_hz) + 0.5)::float as speed_class_hz,
                count(sequence)::int as frames, 0::bigint as lost, count(*) filter (event = 'AlarmRaised')::int as alarms,
                null::varchar as quality, {figures} from {raw} where journal <= {last} group by all)
            to '{partition}/part-{unit:020}-{unit:020}.parquet' (format parquet)""")
    line = json.dumps({"unit": unit, "machine": machine, "day": "2026-01-01", "last": last})
    with (rollup / lake.LEDGER).open("a") as ledger:
        ledger.write(f"\n{line}\n")


class Rollup(unittest.TestCase):
    def setUp(self):
        test_fleet.Fleet.setUp(self)
        self.history, self.rollup = self.folder / "history", self.folder / "history-rollup"
        level = lambda hour: 1.0 + 0.01 * hour + 0.5 * (hour % 3)
        for first in (0, 100):
            test_fleet.write(self.history, first, 100, rms=level)
        self.rollup.mkdir()

    def answers(self):
        connection = lake.open_history(self.history)
        trend = lake.trend(connection, "n").fetchall()
        overview = [row[:2] + row[10:] for row in lake.overview(connection).fetchall()]
        return trend, overview, lake.drifting(connection).fetchall(), lake.departures(connection, days=2).fetchall()

    def same(self, one, other):
        for a, b in zip(one, other, strict=True):
            for left, right in zip(a, b, strict=True):
                for x, y in zip(left, right, strict=True):
                    self.assertAlmostEqual(x, y, places=5) if isinstance(x, float) else self.assertEqual(x, y)

    def test_claim_answers_are_the_same_before_and_behind_rolling_up_and_thinning(self):
        raw = self.answers()
        self.assertEqual((len(raw[0]), raw[1][0][2]), (200, 200))
        roll(self.history, self.rollup, 0, 99)
        self.same(self.answers(), raw)
        for path in self.history.glob(f"*/*/part-*{99:020}.parquet"):
            path.unlink()
        self.assertEqual(lake.open_history(self.history).sql("select count(*) from history").fetchall(), [(100,)])
        self.same(self.answers(), raw)
        roll(self.history, self.rollup, 1, 199)
        shutil.rmtree(self.history)
        with self.subTest("all raw rows are gone"):
            held = lake.trend(lake.open_history(self.history), "n").fetchall()
            self.assertEqual(len(held), 200)
            self.assertEqual(len(lake.overview(lake.open_history(self.history)).fetchall()), 1)

    def test_claim_rows_that_came_behind_their_unit_count_once_also_when_merged_with_those_of_it(self):
        raw = self.answers()
        roll(self.history, self.rollup, 0, 99)
        for path in self.history.glob("*/*/part-*.parquet"):
            path.unlink()
        test_fleet.write(self.history, 0, 200, rms=lambda hour: 1.0 + 0.01 * hour + 0.5 * (hour % 3))
        self.same(self.answers(), raw)

    def test_fault_a_unit_without_a_line_does_not_count(self):
        raw = self.answers()
        roll(self.history, self.rollup, 0, 99)
        ledger = (self.rollup / lake.LEDGER).read_text()
        roll(self.history, self.rollup, 1, 199)
        (self.rollup / lake.LEDGER).write_text(ledger + '{"unit": 1, "mach')
        self.same(self.answers(), raw)

    def test_theory_extremes_of_a_trend_and_of_a_curve_are_those_of_the_raw_rows(self):
        values = [1.0 + 0.01 * hour + 0.5 * (hour % 3) for hour in range(200)]
        roll(self.history, self.rollup, 0, 99)
        connection = lake.open_history(self.history)
        for level in ("minute", "hour", "day"):
            rows = lake.trend(connection, "n", level=level).fetchall()
            self.assertAlmostEqual(min(row[4] for row in rows), min(values), places=5)
            self.assertAlmostEqual(max(row[5] for row in rows), max(values), places=5)
        speed, points = page.commonest(connection, "n", "rms")
        self.assertEqual(speed, 0.5)
        self.assertAlmostEqual(max(point[3] for point in points), max(values), places=5)
        self.assertTrue(all(low <= value + 1e-6 and value <= high + 1e-6 for _, value, low, high in points))

    def test_claim_the_page_is_drawn_from_rollups(self):
        roll(self.history, self.rollup, 0, 199)
        shutil.rmtree(self.history)
        index = page.write(self.history, self.folder / "page")
        self.assertIn("1 nodes", index.read_text())
        self.assertIn("polyline", (self.folder / "page" / page.file_name("n")).read_text())

    def test_cost_a_question_opens_the_files_that_it_names_and_no_others(self):
        roll(self.history, self.rollup, 0, 99)
        connection = lake.open_history(self.history)
        lake.trend(connection, "n", level="day").fetchall()
        self.assertEqual(set(connection.waiting), {"history", "rollup_minute", "rollup_hour"})
        views = "select count(*) from duckdb_views() where not internal"
        self.assertEqual(connection.connection.sql(views).fetchall(), [(2,)])
        self.assertEqual(connection.everything().sql(views).fetchall(), [(5,)])

    def test_fault_steps_that_would_divide_a_class_are_refused(self):
        with self.assertRaisesRegex(ValueError, "multiple of 1.0 Hz"):
            lake.trend(lake.open_history(self.history), "n", speed_step=0.5)
        with self.assertRaisesRegex(ValueError, "no level"):
            lake.trend(lake.open_history(self.history), "n", level="week")


if __name__ == "__main__":
    unittest.main()
