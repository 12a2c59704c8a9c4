"""Removes noise from a recorded displacement, without a shift in time.

Noise makes small turning points, and the operators turn with them. A least-squares parabola through
each sample and its neighbours (Savitzky and Golay 1964) reduces the noise and delays nothing.

The drive has no noise and decides how many neighbours are allowed. Its rising path, the sum of all
its rises, bends at each turn, as the displacement of a stage with hysteresis does; so does its
falling path. If a drive bends too sharply, as in a jump, the displacement stays as it is. One
window serves the whole record: with longer windows where the drive is slow, models of the simulated
stage tracked worse (worst true error 0.30 instead of 0.24 %).
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from piezod.experiment.fit.record import Record, Rows
from piezod.hysteresis.memory import FloatArray

WINDOWS = (101, 75, 55, 41, 31, 23, 17, 13, 11, 9, 7, 5)
"""Window lengths in samples, longest first."""
MAX_CHANGE = 5e-4
"""Largest change of the rising or falling path of a drive by smoothing, as a share of its range."""
MAX_SHARP_SHARE = 0.04
"""Largest share of a record that may exceed that change."""


def smoothed(values: FloatArray, window: int) -> FloatArray:
    """Return values over time, shape (n,), each replaced by a parabola through its neighbours.

    At both ends, the outermost full parabola is used.

    Args:
        values: (n,) values, evenly in time.
        window: Samples under each parabola, odd and at most n; up to 3 changes nothing.
    """
    if window <= 3:
        return values
    half, (powers, fit) = window // 2, _parabola(window)
    first, last = fit @ values[:window], fit @ values[-window:]
    inside = np.convolve(values, fit[0], mode="valid")
    return np.concatenate((powers[:half] @ first, inside, powers[-half:] @ last))


@lru_cache(maxsize=len(WINDOWS))
def _parabola(window: int) -> tuple[FloatArray, FloatArray]:
    """Return the powers of the places in a window, (window, 3), and what fits a parabola to values.

    The weights of a least-squares parabola, (3, window), are the same everywhere.
    """
    half = window // 2
    powers = np.vander(np.arange(-half, half + 1) / half, 3, increasing=True)
    fit = np.asarray(np.linalg.pinv(powers), np.float64)
    powers.flags.writeable = fit.flags.writeable = False
    return powers, fit


def longest_window(drive_v: FloatArray) -> int:
    """Return the longest window for a drive, in samples; 1 if none is allowed.

    Args:
        drive_v: (n,) drive of a record, in V.
    """
    for window in WINDOWS:
        if window <= drive_v.size and np.mean(_too_sharp(drive_v, window)) <= MAX_SHARP_SHARE:
            return window
    return 1


def smoothed_record(record: Record) -> Record:
    """Return a record whose displacement is smoothed where its drive allows it."""
    window = longest_window(record.drive_v)
    if window <= 3:
        return record
    kept = _near(_too_sharp(record.drive_v, window), window)
    position_um = np.where(kept, record.position_um, smoothed(record.position_um, window))
    return replace(record, position_um=position_um)


def _too_sharp(drive_v: FloatArray, window: int) -> Rows:
    """Return the samples at which a drive bends too sharply for a window, shape (n,)."""
    steps_v = np.diff(drive_v, prepend=drive_v[0])
    sharp = np.zeros(drive_v.size, dtype=np.bool_)
    for path_v in (np.cumsum(np.maximum(steps_v, 0.0)), np.cumsum(np.minimum(steps_v, 0.0))):
        sharp |= np.abs(smoothed(path_v, window) - path_v) > MAX_CHANGE * np.ptp(drive_v)
    return sharp


def _near(places: Rows, distance: int) -> Rows:
    """Return the samples within a distance of any of these places, shape (n,)."""
    # Cumulative counts answer "any place in this interval?" by one difference.
    count = np.concatenate(([0], np.cumsum(places)))
    here = np.arange(places.size)
    first, last = np.maximum(here - distance, 0), np.minimum(here + distance, places.size - 1)
    near: Rows = count[last + 1] > count[first]
    return near
