"""The same job by PySpark: `mapInArrow` over the records' folders."""

import os
import sys

import pyarrow as pa

from . import verdicts


def run(records, command=("loop",), workers=2, partitions=None, **options):
    """Verdicts of all records as a table, sorted by record; local mode with so many worker processes."""
    from pyspark.sql import SparkSession

    os.environ.setdefault("PYSPARK_PYTHON", sys.executable)
    # Workers import this package as the driver did.
    paths = os.pathsep.join(path for path in sys.path if path)
    os.environ["PYTHONPATH"] = paths
    builder = SparkSession.builder.master(f"local[{int(workers)}, 4]").appName("meshband-fleet")
    settings = {
        "spark.ui.enabled": "false",
        "spark.driver.host": "127.0.0.1",
        "spark.driver.bindAddress": "127.0.0.1",
        "spark.sql.execution.arrow.maxRecordsPerBatch": "4",
        "spark.python.worker.reuse": "true",
    }
    for key, value in settings.items():
        builder = builder.config(key, value)
    session = builder.getOrCreate()
    session.sparkContext.setLogLevel("ERROR")
    try:
        frame = session.createDataFrame([(str(record),) for record in records], "record string")
        frame = frame.repartition(partitions or max(4 * workers, 1))
        schema = "record string, content string, command string, status string, exit_code int, message string, verdict string, seconds double"
        rows = frame.mapInArrow(verdicts.mapper(command, **options), schema).orderBy("record").collect()
        return pa.Table.from_pylist([row.asDict() for row in rows], schema=verdicts.SCHEMA)
    finally:
        session.stop()
