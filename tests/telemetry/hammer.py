"""Writes records into a ring without a pause: `python hammer.py FILE COUNT`."""

import sys
from pathlib import Path

from piezod.telemetry.layout import AXIS_FIELDS, CYCLE_FIELDS
from piezod.telemetry.ring import RingWriter
from piezod.telemetry.shared_map import attach

shared = attach(Path(sys.argv[1]), writable=True)
writer = RingWriter(shared)
codes = [each.code for each in (*CYCLE_FIELDS, *AXIS_FIELDS, *AXIS_FIELDS)]
for number in range(1, int(sys.argv[2]) + 1):
    made = {"q": number, "Q": number, "d": float(number), "B": number % 256, "?": True}
    writer.append([made[code] for code in codes if code in made])
