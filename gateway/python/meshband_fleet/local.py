"""The same job on one machine without an engine: a pool of processes."""

import multiprocessing

import pyarrow as pa

from . import verdicts


def one(job):
    """A worker's part: one record through the function of batches."""
    record, command, options = job
    return next(iter(verdicts.mapper(command, **options)([verdicts.batch([record])])))


def run(records, command=("loop",), workers=2, **options):
    """Verdicts of all records as a table, in the records' order."""
    jobs = [(str(record), tuple(command), options) for record in records]
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        return pa.Table.from_batches(pool.map(one, jobs, chunksize=1), schema=verdicts.SCHEMA)
