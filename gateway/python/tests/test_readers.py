"""Other programs on the same folders: one line each opens a folder of exports, and no machine's name is taken for a number."""

import importlib.util
import pathlib
import re
import unittest

import duckdb
import pyarrow.dataset
import pyarrow.parquet

from meshband_fleet import lake
import test_fleet

#: What the gateway calls the list that lies beside `machine=...` in a folder of exports.
LIST = re.search(
    r'pub const LIST: &str = "([^"]+)"',
    (pathlib.Path(__file__).parents[2] / "src" / "history" / "export.rs").read_text(),
)[1]

#: The one line of each program.
PROGRAMS = {
    "pyarrow.dataset": lambda pyarrow, folder: pyarrow.dataset.dataset(folder, partitioning="hive").to_table(),
    "pyarrow": lambda pyarrow, folder: pyarrow.parquet.read_table(folder),
    "pandas": lambda pandas, folder: pandas.read_parquet(folder),
    # polars takes no folder that holds anything but Parquet, whatever its name.
    "polars": lambda polars, folder: polars.read_parquet(f"{folder}/**/*.parquet", hive_partitioning=True),
}

#: What gives a column as a list.
LISTS = {"pyarrow": "to_pylist", "pandas": "tolist", "polars": "to_list"}


class Readers(unittest.TestCase):
    setUp = test_fleet.Fleet.setUp

    def exports(self):
        """Three files of two machines, and the list."""
        for first, machine in ((0, "mill-1"), (10, "mill-2"), (20, "mill-1")):
            test_fleet.write(self.folder, first, 10, machine=machine, rms=lambda hour: float(hour))
        (self.folder / LIST).write_text('\n{"capture":1,"node":"n","machine":"mill-1","from":0,"day":"","first":0,"last":9}\n')
        return str(self.folder)

    def opened(self, name):
        package = name.split(".")[0]
        if importlib.util.find_spec(package) is None:
            self.skipTest(f"{package} is not installed")
        table = PROGRAMS[name](importlib.import_module(package), self.exports())
        values, machines = (getattr(table[column], LISTS[package])() for column in ("rms", "machine"))
        self.assertEqual((len(values), sum(values), set(machines)), (30, sum(range(30)), {"mill-1", "mill-2"}))

    def test_claim_pyarrow_opens_a_folder_of_exports(self):
        self.opened("pyarrow")

    def test_claim_pyarrow_opens_a_folder_of_exports_as_a_dataset(self):
        self.opened("pyarrow.dataset")

    def test_claim_pandas_opens_a_folder_of_exports(self):
        self.opened("pandas")

    def test_claim_polars_opens_a_folder_of_exports(self):
        self.opened("polars")

    def test_claim_duckdb_opens_a_folder_of_exports(self):
        line = f"select count(*), sum(rms), count(distinct machine) from '{self.exports()}/**/*.parquet'"
        self.assertEqual(duckdb.sql(line).fetchall(), [(30, sum(range(30)), 2)])

    def test_claim_the_lake_takes_no_machine_name_for_a_number_or_a_date(self):
        for name in ("0x10", "007", "7", "-1", "2026-02-03", "inf", "null", "epoch", "mill-1"):
            folder = self.folder / f"only {name}"
            test_fleet.write(folder, 0, 10, machine=name)
            connection = lake.open_history(folder)
            self.assertEqual([row[0] for row in lake.overview(connection).fetchall()], [name])
            kinds = dict(connection.sql("select column_name, column_type from (describe history)").fetchall())
            self.assertEqual((kinds["machine"], kinds["day"]), ("VARCHAR", "DATE"))


if __name__ == "__main__":
    unittest.main()
