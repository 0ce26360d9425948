"""Assembles many measurements on a cluster: one task is one part of one measurement, made by the command `rcg` in a process of its own.

    pip install "distributed>=2026.8"
    python collection_on_dask.py COLLECTION --parts 8                          # on all cores of this computer
    python collection_on_dask.py COLLECTION --parts 8 --scheduler tcp://HOST:8786

Every worker has to see the folder under the same path, on a file system that keeps locks (local, NFSv4, SMB). A part is whole or not there, and is
the same however often it is made, so a task whose worker dies is simply done again, elsewhere. When all parts of a measurement are there, one more
task puts them together; the result is to the bit that of `rcg assemble` in one process.

The scheduler sees no arrays: a task is a line of words and its result is a name. Each future is released as it completes, so that its memory does
not grow with the number of tasks (https://github.com/dask/distributed/issues/8182).
"""

import argparse
import os
import subprocess
import time
from pathlib import Path

from distributed import Client, LocalCluster, as_completed

# How often a task is begun: workers may die, disks be full for a while.
ATTEMPTS = 5
# So long, in seconds, a task waits for the command that a worker has left behind when it died, and which still makes the part.
PATIENCE_S = 3600


def assemble(measurement: str, *more: str, rcg: str = "rcg") -> str:
    """One task: `rcg assemble` on `measurement` with further options, on one core; returns the measurement."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        done = subprocess.run(
            [rcg, "assemble", measurement, *more, "--quiet"],
            # Workers share the cores among themselves.
            env={**os.environ, "RAYON_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
        )
        if "only one who writes there" not in done.stderr or time.monotonic() > deadline:
            break
        time.sleep(0.2)
    if done.returncode:
        raise RuntimeError(done.stderr.strip() or f"rcg assemble {measurement} ended with {done.returncode}")
    return measurement


def measurements_of(collection: Path) -> list[str]:
    """The measurements below the folder, in the order of their names: directories with frames."""
    return sorted(str(raw.parent.resolve()) for raw in collection.rglob("raw.zarr"))


def run(client: Client, measurements: list[str], parts: int, rcg: str = "rcg", progress=print) -> list[str]:
    """Assembles all `measurements` in so many `parts` each, and returns those that are done, in the order of their ends."""
    missing = dict.fromkeys(measurements, parts)
    options = {"rcg": rcg, "pure": False, "retries": ATTEMPTS - 1}
    tasks = as_completed(
        client.submit(assemble, one, "--part", f"{number}/{parts}", key=f"part-{number}-of-{one}", **options)
        for one in measurements
        for number in range(1, parts + 1)
    )
    done = []
    for task in tasks:
        one, is_part = task.result(), task.key.startswith("part-")
        task.release()
        if not is_part:
            done.append(one)
            progress(f"{len(done)} of {len(measurements)}: {one}")
            continue
        missing[one] -= 1
        if missing[one] == 0:
            tasks.add(client.submit(assemble, one, "--finish", key=f"finish-{one}", **options))
    return done


def main() -> None:
    parser = argparse.ArgumentParser(description="Assembles all measurements below a folder on a cluster.")
    parser.add_argument("collection", type=Path, help="folder of measurements whose frames are captured")
    parser.add_argument("--parts", type=int, default=8, help="parts of each measurement (default: 8)")
    parser.add_argument("--scheduler", help="address of a scheduler (default: a cluster of this computer's cores)")
    parser.add_argument("--rcg", default="rcg", help="the command, as the workers find it (default: rcg)")
    given = parser.parse_args()
    measurements = measurements_of(given.collection)
    if not measurements:
        parser.error(f"{given.collection}: expected measurements with frames (raw.zarr), found none")
    if given.parts < 1:
        parser.error(f"--parts: expected a whole number from 1, found {given.parts}")
    cluster = given.scheduler or LocalCluster(threads_per_worker=1)
    with Client(cluster) as client:
        run(client, measurements, given.parts, given.rcg)
    if cluster is not given.scheduler:
        cluster.close()


if __name__ == "__main__":
    main()
