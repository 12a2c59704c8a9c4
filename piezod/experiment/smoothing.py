"""Noise out of a recorded displacement, without moving it in time.

Where noise makes small turning points, the operators turn with it. A least-squares parabola through
each sample and its neighbours (Savitzky and Golay 1964) takes the noise down and delays nothing. How
many neighbours a record can bear is asked of its drive, which has no noise: what smoothing would do
to the drive, it does to the displacement.
"""

import numpy as np

from piezod.experiment.record import Record
from piezod.hysteresis.memory import FloatArray

LONGEST = 9
"""Most samples in a window."""
BEARABLE = 5e-4
"""Part of its range by which smoothing may change the drive, at worst."""


def smoothed(values: FloatArray, window: int) -> FloatArray:
    """Return values over time, shape (n,), each replaced by a parabola through its neighbours.

    Args:
        values: (n,) evenly in time.
        window: Samples under each parabola, odd; up to 3 change nothing.
    """
    if window <= 3:
        return values
    half = window // 2
    places = np.arange(-half, half + 1, dtype=np.float64)
    weights = np.linalg.pinv(np.vander(places, 3, increasing=True))[0]
    return np.convolve(np.pad(values, half, mode="edge"), weights, mode="valid")


def longest_window(drive_v: FloatArray) -> int:
    """Return the longest window, in samples, that a drive can bear; 1 where it bears none.

    Args:
        drive_v: (n,) drive of a record, in V.
    """
    bearable_v = BEARABLE * float(np.ptp(drive_v))
    for window in range(LONGEST, 3, -2):
        if float(np.max(np.abs(smoothed(drive_v, window) - drive_v))) <= bearable_v:
            return window
    return 1


def smoothed_record(record: Record, window: int) -> Record:
    """Return a record with its displacement smoothed, its drive as it is."""
    return Record(record.t_s, record.drive_v, smoothed(record.position_um, window))
