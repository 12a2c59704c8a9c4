"""Noise out of a recorded displacement, without moving it in time.

Where noise makes small turning points, the operators turn with it. A least-squares parabola through
each sample and its neighbours (Savitzky and Golay 1964) takes the noise down and delays nothing.
How many neighbours a record can bear is asked of its drive, which has no noise: its way up alone,
the sum of all that it rises, bends at each turn, as the displacement of a stage with hysteresis
does, and so does its way down. Where a drive bends too sharply, as in a jump, the displacement
stays as it is. There is one window for a whole record: with longer ones where the drive is slow,
models of the simulated stage tracked worse (worst true error 0.30 instead of 0.24 %).
"""

from dataclasses import replace

import numpy as np

from piezod.experiment.fit.record import Record, Rows
from piezod.hysteresis.memory import FloatArray

WINDOWS = (101, 75, 55, 41, 31, 23, 17, 13, 11, 9, 7, 5)
"""Samples under a parabola, longest first."""
BEARABLE = 5e-4
"""Part of its range by which smoothing may change the way up or down of a drive."""
RARE = 0.04
"""Part of a record that may bend more sharply than that."""


def smoothed(values: FloatArray, window: int) -> FloatArray:
    """Return values over time, shape (n,), each replaced by a parabola through its neighbours.

    At both ends, the parabola through the outermost ones.

    Args:
        values: (n,) evenly in time.
        window: Samples under each parabola, odd and at most n; up to 3 change nothing.
    """
    if window <= 3:
        return values
    half = window // 2
    places = np.arange(-half, half + 1) / half
    powers = np.vander(places, 3, increasing=True)
    fit = np.linalg.pinv(powers)
    first, last = fit @ values[:window], fit @ values[-window:]
    inside = np.convolve(values, fit[0], mode="valid")
    return np.concatenate((powers[:half] @ first, inside, powers[-half:] @ last))


def longest_window(drive_v: FloatArray) -> int:
    """Return the longest window, in samples, that a drive can bear; 1 where it bears none.

    Args:
        drive_v: (n,) drive of a record, in V.
    """
    for window in WINDOWS:
        if window <= drive_v.size and np.mean(_too_sharp(drive_v, window)) <= RARE:
            return window
    return 1


def smoothed_record(record: Record) -> Record:
    """Return a record with its displacement smoothed where its drive bears it."""
    window = longest_window(record.drive_v)
    if window <= 3:
        return record
    kept = _near(_too_sharp(record.drive_v, window), window)
    position_um = np.where(kept, record.position_um, smoothed(record.position_um, window))
    return replace(record, position_um=position_um)


def _too_sharp(drive_v: FloatArray, window: int) -> Rows:
    """Return where a drive bends too sharply for a window, shape (n,)."""
    steps_v = np.diff(drive_v, prepend=drive_v[0])
    sharp = np.zeros(drive_v.size, dtype=np.bool_)
    for way_v in (np.cumsum(np.maximum(steps_v, 0.0)), np.cumsum(np.minimum(steps_v, 0.0))):
        sharp |= np.abs(smoothed(way_v, window) - way_v) > BEARABLE * np.ptp(drive_v)
    return sharp


def _near(places: Rows, distance: int) -> Rows:
    """Return which samples have one of these places no farther away than that, shape (n,)."""
    count = np.concatenate(([0], np.cumsum(places)))
    here = np.arange(places.size)
    first, last = np.maximum(here - distance, 0), np.minimum(here + distance, places.size - 1)
    near: Rows = count[last + 1] > count[first]
    return near
