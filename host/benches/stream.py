#!/usr/bin/env python3
"""Frames to memory and disk: `rcg camera bench --source synthetic` against `dd` and a writer in NumPy and zarr-python, in one run.

Needs NumPy and zarr (`pip install zarr numpy`) and a release build of the command. Each case writes mono8 frames of one process into a
`raw.zarr`; `dd` writes as many zeros; zarr-python writes the same chunks (CRC-32C, no compression) of frames that NumPy copies. Of two
runs of each, one after the other, the better one counts. Writes some 60 GB, no more than 10 GB at a time:
`stream.py --disk DIR --memory /dev/shm [--seconds 60] [--rcg target/release/rcg]`.
"""

import argparse
import json
import pathlib
import re
import shutil
import subprocess
import tempfile
import time

import numpy
import zarr

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
SEGMENT_BYTES = 16 << 20


def clean(folder):
    """Removes what a run has left, and waits until the disk has nothing to do."""
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run(["sync"], check=True)


def rcg(command, folder, size, seconds, rate=None):
    """The answer of the command, with the bytes that it wrote."""
    line = [command, "camera", "bench", "--source", "synthetic", "--json", "-q", "--to", str(folder / "rcg")]
    line += ["--image-size", str(size), "--seconds", str(seconds)]
    line += ["--frames-per-s", str(rate)] if rate else []
    answer = json.loads(subprocess.run(line, check=True, capture_output=True, text=True).stdout)
    answer["bytes"] = answer["frames"] * size * size
    clean(folder / "rcg")
    return answer


def dd(folder, total):
    """Bytes a second that `dd` hands to the system, and that the disk has."""
    found = []
    for sync in ([], ["conv=fsync"]):
        line = ["dd", "if=/dev/zero", f"of={folder / 'dd'}", "bs=1M", f"count={total >> 20}", *sync]
        said = subprocess.run(line, check=True, capture_output=True, text=True, env={"LC_ALL": "C", "PATH": "/usr/bin:/bin"}).stderr
        (folder / "dd").unlink()
        subprocess.run(["sync"], check=True)
        written, seconds = re.search(r"(\d+) bytes.*?, ([\d.e+-]+) s,", said).groups()
        found.append(int(written) / float(seconds))
    return found


def zarr_python(folder, size, seconds):
    """Frames a second of a writer in Python."""
    chunk = max(8, min(4096, SEGMENT_BYTES // (size * size)))
    noise = numpy.random.default_rng(1).normal(64, 8, size * size + 64 * 61).astype(numpy.uint8)
    store = zarr.create_array(
        store=str(folder / "zarr"),
        shape=(chunk * 100_000, size, size),
        chunks=(chunk, size, size),
        dtype="uint8",
        compressors=[zarr.codecs.Crc32cCodec()],
    )
    buffer = numpy.empty((chunk, size, size), numpy.uint8)
    began, frames = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        for place in range(chunk):
            start = (frames + place) % 64 * 61
            buffer[place] = noise[start : start + size * size].reshape(size, size)
        store[frames : frames + chunk] = buffer
        frames += chunk
    rate = frames / (time.perf_counter() - began)
    clean(folder / "zarr")
    return rate


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--disk", type=pathlib.Path, default=ROOT / "target")
    parser.add_argument("--memory", type=pathlib.Path, default=pathlib.Path("/dev/shm"))
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--rcg", default=str(ROOT / "target/release/rcg"))
    args = parser.parse_args()
    third = args.seconds / 3
    print("size  to      asked/s  frames/s     MB/s   lost  ring      dd MB/s   of dd  synced  of dd  zarr-python  ratio")
    for size, where, rate, seconds in (
        (96, "disk", 9523, args.seconds),
        (1024, "memory", 400, third),
        (96, "disk", None, third / 2),
        (1024, "disk", None, third / 4),
        (1024, "memory", None, third / 4),
    ):
        with tempfile.TemporaryDirectory(dir=getattr(args, where)) as folder:
            folder = pathlib.Path(folder)
            first = rcg(args.rcg, folder, size, seconds, rate)
            before = dd(folder, first["bytes"])
            # At a pace one run says all.
            second = first if rate else rcg(args.rcg, folder, size, seconds, rate)
            after = dd(folder, second["bytes"])
            theirs = zarr_python(folder, size, min(seconds, 10))
        ours = max(first, second, key=lambda run: run["bytes_per_s"])
        plain, synced = (max(pair) for pair in zip(before, after))
        written = ours["bytes_per_s"]
        on_disk = max(run["bytes"] / run["synced_s"] for run in (first, second))
        ring = f"{ours['ring_high_water']}/{ours['ring_frames']}"
        print(
            f"{size:>4}  {where:6}  {rate or '-':>7}  {ours['frames_per_s']:>8.0f}  {written / 1e6:>7.0f}  {ours['lost']:>5}  {ring:9}"
            f" {plain / 1e6:>7.0f}  {written / plain:>6.2f}  {on_disk / 1e6:>6.0f}  {on_disk / synced:>5.2f}"
            f"  {theirs:>11.0f}  {ours['frames_per_s'] / theirs:>5.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
