"""Long records made short enough to fit, without losing what their drive does."""

from dataclasses import replace

import numpy as np

from piezod.experiment.fit.record import Record
from piezod.experiment.fit.smoothing import longest_window
from piezod.hysteresis.memory import FloatArray

ENOUGH = 20_000
"""A record of no more samples stays as it is."""
MOST = 100_000
"""Samples beyond this are left out where averaging would lose what the drive does."""
PER_WINDOW = 8
"""Averages are taken over this part of the samples that smoothing could take at the least."""


def thinned(record: Record) -> Record:
    """Return a record with neighbouring samples averaged, as far as it is long and its drive slow.

    Drive and displacement are averaged alike, so that neither is moved against the other. What is
    still too long then ends earlier.
    """
    while record.t_s.size > ENOUGH:
        bears = longest_window(record.drive_v) // PER_WINDOW
        count = min(bears, -(-record.t_s.size // ENOUGH))
        if count < 2:
            break
        record = _averaged(record, count)
    kept = slice(MOST)
    return replace(
        record,
        t_s=record.t_s[kept],
        drive_v=record.drive_v[kept],
        position_um=record.position_um[kept],
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
    )
