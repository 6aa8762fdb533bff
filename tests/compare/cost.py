#!/usr/bin/env python3
"""Processor seconds, wall seconds and peak memory (MB) of one command, on one line.

    python cost.py PROGRAM ARGUMENTS...

Processor time is that of the command and its threads, user and system; the peak is its largest resident set.
With `--make FOLDER` it writes the signal files whose import `cargo xtask bench` times, instead: two channels of
noise from a fixed seed as npy (16 bit), wav and csv, and eight MAT-files of one channel in double precision each, as many and as
long as the measured bench's of eight accelerometers. With `--disk RECORD FILES...` it takes as long as the disk does, instead: FILES read past
the page cache, and a copy of the folder RECORD written so that a power cut would leave it or nothing: its files and itself brought to the
disk, a new name, the folder above brought to the disk.
"""
import mmap, os, resource, subprocess, sys, time


def cost(words):
    start = time.perf_counter()
    done = subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    wall = time.perf_counter() - start
    if done.returncode != 0:
        sys.exit(f"{' '.join(words)}: exit code {done.returncode}: {done.stderr.strip()[-300:]}")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{used.ru_utime + used.ru_stime:.4f} {wall:.4f} {used.ru_maxrss / 1024:.1f}")


def make(folder):
    import wave
    from pathlib import Path
    import numpy as np

    codes = np.random.default_rng(1).integers(-20000, 20000, (4_000_000, 2), dtype=np.int16)
    np.save(Path(folder) / "signal.npy", codes)
    with wave.open(str(Path(folder) / "signal.wav"), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(50_000)
        file.writeframes(codes.tobytes())
    np.savetxt(Path(folder) / "signal.csv", codes[:1_000_000] / 1000.0, fmt="%.3f", delimiter=",")
    import scipy.io

    noise = np.random.default_rng(2)
    for channel in range(8):
        data = {"Data": noise.standard_normal((283_000, 1))}
        scipy.io.savemat(Path(folder) / f"channel{channel}.mat", data)


def to_disk(path):
    descriptor = os.open(path, os.O_RDONLY)
    os.fsync(descriptor)
    os.close(descriptor)


def disk(record, files):
    contents = {}
    for name in os.listdir(record):
        with open(os.path.join(record, name), "rb") as file:
            contents[name] = file.read()
    copy = record.rstrip("/") + ".copy"
    buffer = mmap.mmap(-1, 1 << 20)
    start = time.perf_counter()
    for name in files:
        descriptor = os.open(name, os.O_RDONLY | os.O_DIRECT)
        while os.readv(descriptor, [buffer]) > 0:
            pass
        os.close(descriptor)
    os.mkdir(copy + ".tmp")
    paths = [os.path.join(copy + ".tmp", name) for name in contents]
    for path, content in zip(paths, contents.values()):
        with open(path, "wb") as file:
            file.write(content)
    for path in [*paths, copy + ".tmp"]:
        to_disk(path)
    os.rename(copy + ".tmp", copy)
    to_disk(os.path.dirname(os.path.abspath(copy)))
    print(f"0 {time.perf_counter() - start:.4f} 0")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["--make", folder]:
            make(folder)
        case ["--disk", record, *files]:
            disk(record, files)
        case words:
            cost(words)
