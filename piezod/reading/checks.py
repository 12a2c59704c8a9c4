"""Checks of recorded columns, and their messages."""

from collections.abc import Callable
from typing import Final, NoReturn

import numpy as np

from piezod.errors import DataError
from piezod.reading.table import FloatArray

MAX_STEP_PERIODS: Final = 1.5
"""Longest allowed time step in median steps: a longer one is a gap, a shorter one is jitter."""
_MOST_SHOWN: Final = 300
_WRAP_SHARE: Final = 0.5
"""A step by more than this share of the range, while the drive hardly moves, is a wrap."""
_WRAP_BACK: Final = 5
"""Samples within which an outlier is over, unlike a wrap."""

Place = Callable[[int], str]
"""Returns where in its file a sample is."""


def check_time(t_s: FloatArray, place: Place, max_step_periods: float = MAX_STEP_PERIODS) -> None:
    """Raise an error for time that does not rise, or that has gaps.

    Args:
        t_s: Time in s, shape (n_samples,).
        place: Where each sample is, for the message.
        max_step_periods: Longest allowed step, in median steps.

    Raises:
        DataError: If a step is zero, negative, or longer than that.
    """
    steps_s = np.diff(t_s)
    if not steps_s.size:
        return
    # The median, not the mean: one long gap must not raise the limit by which it is found.
    longest_s = max_step_periods * float(np.median(steps_s))
    backward = np.flatnonzero(steps_s <= 0)
    if backward.size:  # checked first: without rising time a gap has no meaning
        index = int(backward[0]) + 1
        verb = "repeats" if t_s[index] == t_s[index - 1] else "comes after"
        what = f"t_s {t_s[index]} {verb} {t_s[index - 1]}"
        remedy = "sort the rows by time, delete double rows, or write t_s with more digits"
        fail(place(index), what, "allowed is time that rises", remedy)
    gaps = np.flatnonzero(steps_s > longest_s)
    if gaps.size:
        index = int(gaps[0]) + 1
        what = f"a gap of {steps_s[index - 1]:.6g} s before t_s {t_s[index]}"
        allowed = (
            f"allowed are {longest_s:.6g} s, {max_step_periods} times the median step; "
            f"{counted(gaps.size, 'such gap')} in the file"
        )
        fail(place(index), what, allowed, "cut the record there, or resample it")


def check_varies(name: str, values: FloatArray, place: Place) -> None:
    """Raise an error for a column that is constant.

    Args:
        name: Name of the column.
        values: Its values, shape (n_samples,), at least one.
        place: Where each sample is, for the message.

    Raises:
        DataError: If all values are equal.
    """
    if np.ptp(values) == 0:
        what = f"{name} is {values[0]} in all {counted(values.size, 'sample')}"
        remedy = "check the cable and the channel, and record again"
        fail(place(0), what, "allowed is a signal that varies", remedy)


def check_unwrapped(drive_v: FloatArray, position_um: FloatArray, place: Place) -> None:
    """Raise an error for a position that jumps back by most of its range, as a phase does.

    Args:
        drive_v: The drive, shape (n_samples,).
        position_um: The position, of the same shape.
        place: Where each sample is, for the message.

    Raises:
        DataError: If it jumps at least twice while the drive hardly moves.
    """
    steps_um, steps_v = np.diff(position_um), np.abs(np.diff(drive_v))
    range_um = np.ptp(position_um)
    if np.percentile(np.abs(steps_um), 90.0) > 0.1 * range_um:
        return  # noise, or a coarse record
    wide = np.abs(steps_um) > _WRAP_SHARE * range_um
    jumps = np.flatnonzero(wide & (steps_v < 0.1 * np.ptp(drive_v)))
    apart = np.diff(jumps, prepend=-_WRAP_BACK - 1, append=steps_um.size + _WRAP_BACK) > _WRAP_BACK
    alone = jumps[apart[:-1] & apart[1:]]  # an outlier jumps back at once
    if len(alone) >= 2:
        index, beside = int(alone[0]) + 1, np.clip((alone - 1, alone + 1), 0, steps_um.size - 1)
        wraps_um = steps_um[alone] - steps_um[beside].mean(axis=0)
        period_um = float(np.median(np.abs(wraps_um)))
        what = f"position_um jumps by {steps_um[index - 1]:.4g} µm while the drive hardly moves"
        allowed = f"{len(alone)} such jumps in the file, as of an interferometer that wraps"
        remedy = f"unwrap it before, as with numpy.unwrap(position_um, period={period_um:.3g})"
        fail(place(index), what, allowed, remedy)


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless the number is 1."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def shortened(text: str) -> str:
    """Return a text from a file, cut to a length that a message can have."""
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]} …"


def fail(place: str, what: str, allowed: str, remedy: str) -> NoReturn:
    """Raise an error about a file, as one line that an editor can jump to.

    Args:
        place: Path of the file, and the line or sample.
        what: The problem and the value found.
        allowed: The allowed values.
        remedy: What to do about it.

    Raises:
        DataError: Always.
    """
    raise DataError(f"{place}: {what}; {allowed}; {remedy}")
