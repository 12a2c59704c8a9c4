"""Writes records into a ring without a pause: `python hammer.py FILE COUNT`."""

import sys
from pathlib import Path

from piezod.telemetry.ring import RingWriter
from piezod.telemetry.shared_map import attach

shared = attach(Path(sys.argv[1]), writable=True)
writer = RingWriter(shared)
for number in range(1, int(sys.argv[2]) + 1):
    cycle: list[float] = [*[number] * 11, number % 256, True, False]
    axis: list[float] = [number, *[float(number)] * 9, number % 256, number % 256, True, number, 0]
    writer.append(cycle + axis * 2)
