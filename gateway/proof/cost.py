"""What a verdict costs: processor seconds of `meshband loop` and `analyse` per record, by the record's duration and rate.

Processor time, not time on the clock: it hardly depends on what else runs. One thread per record, as jobs run it. Records are those
of the Spark proof (its contents by turns, seeds from 1).
"""

import argparse
import os
import pathlib
import resource
import statistics
import subprocess
import tempfile

import spark_proof

#: Duration, s, and rate, Hz.
SIZES = ((2.0, 12_800.0), (2.0, 25_600.0), (2.0, 51_200.0), (10.0, 25_600.0))


def seconds(words):
    """Processor seconds of one call."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(words, check=True, capture_output=True, env={**os.environ, "RAYON_NUM_THREADS": "1"})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--records", type=int, default=8, help="of each size")
    arguments = parser.parse_args()
    program = arguments.program.resolve()
    print("| record | size | `loop`: s, median (least to most) | per core hour | `analyse`: s, median | per core hour |")
    print("| --- | --- | --- | --- | --- | --- |")
    for duration, rate in SIZES:
        with tempfile.TemporaryDirectory(prefix="meshband-cost-") as temporary:
            folder = pathlib.Path(temporary)
            size = argparse.Namespace(program=program, duration=duration, rate=rate, records=arguments.records + 2)
            records = spark_proof.make(size, folder)[:-2]
            size_kb = sum(path.stat().st_size for path in records[0].iterdir()) / 1000
            answer = ["--json", folder / "answer.json", "--force"]
            taken = {name: [seconds([program, name, record, *answer]) for record in records] for name in ("loop", "analyse")}
        cells = [f"{duration:g} s at {rate:g} Hz", f"{size_kb:.0f} kB"]
        for name, times in taken.items():
            middle = statistics.median(times)
            spread = f" ({min(times):.2f} to {max(times):.2f})" if name == "loop" else ""
            cells += [f"{middle:.2f}{spread}", f"{3600 / middle:.0f}"]
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
