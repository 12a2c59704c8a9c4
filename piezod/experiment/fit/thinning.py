"""Shortens long records for a fit, without loss of the motion of their drive."""

from dataclasses import replace

import numpy as np

from piezod.experiment.fit.record import Record
from piezod.experiment.fit.smoothing import longest_window
from piezod.hysteresis.memory import FloatArray

UNAVERAGED_SAMPLES = 20_000
"""A record of up to this many samples is not averaged."""
MAX_SAMPLES = 100_000
"""Later samples are dropped if averaging would lose motion of the drive."""
PER_WINDOW = 8
"""An average covers at most this fraction (1/8) of the longest smoothing window."""


def thinned(record: Record) -> Record:
    """Return a record with neighbouring samples averaged, if it is long and its drive slow.

    Drive and displacement are averaged alike, so that neither is shifted against the other. A
    record that is still too long then ends earlier.
    """
    while record.t_s.size > UNAVERAGED_SAMPLES:
        allowed = longest_window(record.drive_v) // PER_WINDOW
        count = min(allowed, -(-record.t_s.size // UNAVERAGED_SAMPLES))
        if count < 2:
            break
        record = _averaged(record, count)
    used = slice(MAX_SAMPLES)
    return replace(
        record,
        t_s=record.t_s[used],
        drive_v=record.drive_v[used],
        position_um=record.position_um[used],
    )


def _averaged(record: Record, count: int) -> Record:
    def mean(values: FloatArray) -> FloatArray:
        whole = values[: values.size // count * count]
        means: FloatArray = np.mean(whole.reshape(-1, count), axis=1)
        return means

    return replace(
        record,
        t_s=mean(record.t_s),
        drive_v=mean(record.drive_v),
        position_um=mean(record.position_um),
        averaged=record.averaged * count,
    )
