"""Checks of recorded columns, and their messages."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

import numpy as np

from piezod.errors import DataError
from piezod.records.frozen import FloatArray

MAX_STEP_PERIODS: Final = 1.5
"""Longest allowed time step in median steps: a longer one is a gap, a shorter one is jitter."""

FIRST_DATA_LINE: Final = 2
"""Line of the first sample, counted from 1; the header is above it."""
_MOST_SHOWN: Final = 300


def check_finite(path: Path, table: FloatArray, names: Sequence[str]) -> None:
    """Raise an error for NaN and infinities.

    Args:
        path: Path of the file, for the message.
        table: Values, shape (n_samples, n_columns).
        names: Names of the columns.

    Raises:
        DataError: If a value is not finite; names the first one.
    """
    bad_rows, bad_columns = np.nonzero(~np.isfinite(table))
    if bad_rows.size:
        what = f"{names[bad_columns[0]]} is {table[bad_rows[0], bad_columns[0]]}"
        remedy = "cut the record there, or fill in the measured value"
        line = int(bad_rows[0]) + FIRST_DATA_LINE
        fail(path, line, what, "allowed is any finite number", remedy)


def check_time(path: Path, t_s: FloatArray, max_step_periods: float = MAX_STEP_PERIODS) -> None:
    """Raise an error for time that does not rise, or that has gaps.

    Args:
        path: Path of the file, for the message.
        t_s: Time in s, shape (n_samples,).
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
        fail(path, index + FIRST_DATA_LINE, what, "allowed is time that rises", remedy)
    gaps = np.flatnonzero(steps_s > longest_s)
    if gaps.size:
        index = int(gaps[0]) + 1
        what = f"a gap of {steps_s[index - 1]:.6g} s before t_s {t_s[index]}"
        allowed = (
            f"allowed are {longest_s:.6g} s, {max_step_periods} times the median step; "
            f"{counted(gaps.size, 'such gap')} in the file"
        )
        fail(path, index + FIRST_DATA_LINE, what, allowed, "cut the record there, or resample it")


def check_varies(path: Path, name: str, values: FloatArray) -> None:
    """Raise an error for a column that is constant.

    Args:
        path: Path of the file, for the message.
        name: Name of the column.
        values: Its values, shape (n_samples,), at least one.

    Raises:
        DataError: If all values are equal.
    """
    if np.ptp(values) == 0:
        what = f"{name} is {values[0]} in all {counted(values.size, 'sample')}"
        remedy = "check the cable and the channel, and record again"
        fail(path, FIRST_DATA_LINE, what, "allowed is a signal that varies", remedy)


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless the number is 1."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def shortened(text: str) -> str:
    """Return a text from a file, cut to a length that a message can have."""
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]} …"


def fail(path: Path, line: int, what: str, allowed: str, remedy: str) -> NoReturn:
    """Raise an error about a file, as one line that an editor can jump to.

    Args:
        path: Path of the file.
        line: Line, counted from 1.
        what: The problem and the value found.
        allowed: The allowed values.
        remedy: What to do about it.

    Raises:
        DataError: Always.
    """
    raise DataError(f"{path}:{line}: {what}; {allowed}; {remedy}")
