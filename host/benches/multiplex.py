#!/usr/bin/env python3
"""Demultiplexing: `cargo bench --bench multiplex` against a NumPy matrix product of the same size, in one run.

Needs NumPy (`pip install numpy`). Prints for each order n of the code the throughput in bytes of f32 input per second
of the fast transform and of `inverse @ frames` (f32, the best of ten, BLAS with all its threads), and their ratio.
"""

import pathlib
import re
import subprocess
import time

import numpy

HOST = pathlib.Path(__file__).resolve().parent.parent
UNITS = {"KB/s": 1e3, "MB/s": 1e6, "GB/s": 1e9}


def fast_transforms():
    """{order: bytes per second}, the fastest sample of the benchmark."""
    command = ["cargo", "bench", "--bench", "multiplex", "--", "--bytes-format", "decimal"]
    lines = subprocess.run(command, cwd=HOST, check=True, capture_output=True, text=True).stdout.splitlines()
    found, order = {}, None
    for line in lines:
        row = re.match(r".*[├╰]─ (\d+) ", line)
        rates = re.findall(r"([\d.]+) ([KMG]B/s)", line)
        if row:
            order = int(row.group(1))
        if rates and order:
            number, unit = rates[0]
            found.setdefault(order, float(number) * UNITS[unit])
    return found


def matrix_product(order):
    """Bytes of frames per second of the inverse S-matrix times frames."""
    pixels = 32 * 32 * 3 if order > 255 else 96 * 96 * 3
    bits = numpy.bitwise_and.outer(numpy.arange(1, order + 1), numpy.arange(1, order + 1))
    parity = numpy.zeros_like(bits)
    while bits.any():
        parity ^= bits & 1
        bits >>= 1
    inverse = ((2 * parity - 1) * (2 / (order + 1))).astype(numpy.float32)
    frames = (numpy.arange(order * pixels) % 4099).astype(numpy.float32).reshape(order, pixels)
    best = float("inf")
    for _ in range(10):
        began = time.perf_counter()
        inverse @ frames
        best = min(best, time.perf_counter() - began)
    return frames.nbytes / best


print(f"{'order':>6} {'transform GB/s':>15} {'NumPy GB/s':>11} {'ratio':>7}")
for order, rate in fast_transforms().items():
    product = matrix_product(order)
    print(f"{order:>6} {rate / 1e9:>15.2f} {product / 1e9:>11.3f} {rate / product:>7.1f}")
