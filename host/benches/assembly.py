#!/usr/bin/env python3
"""Assembly: `rcg assemble` against a straightforward one in NumPy and against writing alone, in one run.

Needs NumPy and zarr (`pip install zarr numpy`), a release build of the command and a measurement, whose frames are assembled again into
files in memory. NumPy takes the offset of the black frames away, divides by irradiance and exposure, interpolates onto the disk, and
makes σ of photons and read noise: no stray light, no slope, no blur. Writing alone is that file without computing anything. Of so
many rounds the quickest counts; seconds are those of the processor, of all threads.
`assembly.py DIR [--rounds 3] [--memory /dev/shm] [--rcg target/release/rcg]`.
"""

import argparse
import json
import pathlib
import resource
import shutil
import subprocess
import tempfile
import time

import numpy
import zarr

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
CHUNK = 32


def timed(work):
    """Seconds by the clock and of the processor, of this process and those that it waited for."""
    spent = lambda: sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    began, before = time.perf_counter(), spent()
    work()
    return time.perf_counter() - began, spent() - before


def taps(size):
    """Indices of the four pixels around each cell of the disk, and their weights: the disk fills the image."""
    y, x = numpy.mgrid[:size, :size]
    u, v = (2 * (x + 0.5) / size - 1, 2 * (y + 0.5) / size - 1)
    rho = numpy.hypot(u, v)
    # From equal area to the nearly stereographic image of the mirror.
    stretch = numpy.tan(numpy.arcsin(numpy.minimum(rho, 1) / numpy.sqrt(2))) / numpy.maximum(rho, 1e-9)
    px, py = ((1 + w * stretch) * size / 2 - 0.5 for w in (u, v))
    inside = (rho < 1) & (px >= 0) & (py >= 0) & (px < size - 1) & (py < size - 1)
    x0, y0 = (numpy.clip(p.astype(int), 0, size - 2) for p in (px, py))
    fx, fy = px - x0, py - y0
    corners = [(0, 0, (1 - fx) * (1 - fy)), (0, 1, fx * (1 - fy)), (1, 0, (1 - fx) * fy), (1, 1, fx * fy)]
    return inside, [((y0 + dy) * size + x0 + dx, w.astype("f4")[..., None]) for dy, dx, w in corners]


def create(path, shape):
    group = zarr.open_group(path, mode="w")
    array = lambda name, shape, kind: group.create_array(
        name, shape=shape, dtype=kind, chunks=(CHUNK, *shape[1:]), compressors=[zarr.codecs.ZstdCodec(level=1), zarr.codecs.Crc32cCodec()]
    )
    return array("f", shape, "f4"), array("sigma", shape, "f2"), array("provenance", shape[:-1], "u1")


def in_numpy(raw, path):
    """Assembles plainly."""
    frames, irradiance, exposure = raw["frames"], raw["lit_irradiance"][:], raw["exposure_s"][:]
    lit = numpy.flatnonzero(irradiance > 0)
    size, channels = frames.shape[1], frames.shape[3]
    inside, corners = taps(size)
    segment = frames.chunks[0]
    dark = frames[:segment][irradiance[:segment] == 0].mean(axis=0, dtype="f4").reshape(-1, channels)
    f_out, sigma_out, provenance_out = create(path, (len(lit), size, size, channels))
    gain, read = numpy.float32(0.15), numpy.float32(2.0)
    for first in range(0, len(lit), CHUNK):
        rows = lit[first : first + CHUNK]
        held = frames[rows[0] : rows[-1] + 1][rows - rows[0]].reshape(len(rows), -1, channels)
        scale = (1 / (irradiance[rows] * exposure[rows])).astype("f4")[:, None, None]
        signal = held.astype("f4") - dark
        variance = (read**2 + numpy.maximum(signal, 0) / gain) * scale**2
        signal *= scale
        f = sum(signal[:, at] * weight for at, weight in corners)
        sigma = numpy.sqrt(sum(variance[:, at] * weight**2 for at, weight in corners))
        f[:, ~inside], sigma[:, ~inside] = numpy.nan, numpy.nan
        end = first + len(rows)
        f_out[first:end], sigma_out[first:end] = f, numpy.minimum(sigma, 65504).astype("f2")
        provenance_out[first:end] = numpy.broadcast_to(inside.astype("u1"), f.shape[:-1])


def write_only(source, path):
    """Writes the bytes of `source` anew."""
    shutil.copytree(source, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("measurement", type=pathlib.Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--memory", default="/dev/shm")
    parser.add_argument("--rcg", default=ROOT / "target/release/rcg")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.memory) as folder:
        folder = pathlib.Path(folder)
        held = folder / "held"
        held.mkdir()
        for name in ("rig.toml", "plan.toml", "manifest.json", "session.json", "calibration.json", "raw.zarr"):
            source = arguments.measurement / name
            if source.is_dir():
                shutil.copytree(source, held / name)
            elif source.exists():
                shutil.copy(source, held)
        raw = zarr.open_group(held / "raw.zarr", mode="r")
        frames = int((raw["lit_irradiance"][:] > 0).sum())
        line = [str(arguments.rcg), "assemble", str(held), "--out", str(folder / "a.zarr"), "-q", "--json"]
        run = lambda more=(): subprocess.run([*line, *more], check=True, capture_output=True)
        found = {}
        for _ in range(arguments.rounds):
            for name, work, made in [
                ("rcg assemble", run, "a.zarr"),
                ("rcg assemble --lossless", lambda: run(["--lossless"]), "a.zarr"),
                ("write only", lambda: write_only(folder / "a.zarr", folder / "w.zarr"), "w.zarr"),
                ("NumPy", lambda: in_numpy(raw, folder / "n.zarr"), "n.zarr"),
            ]:
                if made != "a.zarr":
                    shutil.rmtree(folder / made, ignore_errors=True)
                clock, processor = timed(work)
                bytes_ = sum(file.stat().st_size for file in (folder / made).rglob("*") if file.is_file())
                best = found.setdefault(name, [clock, processor, bytes_])
                best[:2] = min(best[0], clock), min(best[1], processor)
        for name, (clock, processor, bytes_) in found.items():
            print(f"{name:<26} {frames / clock:8.0f} frames/s, {1e3 * processor / frames:6.3f} ms of the processor a frame, {bytes_ / 1e6:8.1f} MB")
        print(json.dumps({"frames": frames, "found": found}))


if __name__ == "__main__":
    main()
