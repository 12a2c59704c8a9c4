"""What recorded columns must be like to be worked with, and the words when they are not."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

import numpy as np

from piezod.errors import DataError
from piezod.records.frozen import FloatArray

MAX_STEP_PERIODS: Final = 1.5
"""Longest step of time in median steps; a longer one is a gap, a shorter one is jitter."""

FIRST_DATA_LINE: Final = 2
"""Line of the first sample, counted from 1; the header is above it."""


def check_finite(path: Path, table: FloatArray, names: Sequence[str]) -> None:
    """Refuse NaN and infinities.

    Args:
        path: The file, for the message.
        table: Values, shape (n_samples, n_columns).
        names: Names of the columns.

    Raises:
        DataError: If a value is not finite; names the first one.
    """
    bad_rows, bad_columns = np.nonzero(~np.isfinite(table))
    if bad_rows.size:
        what = f"{names[bad_columns[0]]} is {table[bad_rows[0], bad_columns[0]]}"
        remedy = "cut the record there, or fill in what was measured"
        line = int(bad_rows[0]) + FIRST_DATA_LINE
        fail(path, line, what, "allowed is any finite number", remedy)


def check_time(path: Path, t_s: FloatArray) -> None:
    """Refuse time that does not rise, or that leaves gaps.

    Args:
        path: The file, for the message.
        t_s: Time in s, shape (n_samples,).

    Raises:
        DataError: If a step is zero, negative, or longer than `MAX_STEP_PERIODS` median steps.
    """
    steps_s = np.diff(t_s)
    if not steps_s.size:
        return
    longest_s = MAX_STEP_PERIODS * float(np.median(steps_s))
    backward = np.flatnonzero(steps_s <= 0)
    if backward.size:
        index = int(backward[0]) + 1
        verb = "repeats" if t_s[index] == t_s[index - 1] else "comes after"
        what = f"t_s {t_s[index]} {verb} {t_s[index - 1]}"
        remedy = "sort the rows by time, delete double ones, write t_s with more digits"
        fail(path, index + FIRST_DATA_LINE, what, "allowed is time that rises", remedy)
    gaps = np.flatnonzero(steps_s > longest_s)
    if gaps.size:
        index = int(gaps[0]) + 1
        what = f"a gap of {steps_s[index - 1]:.6g} s before t_s {t_s[index]}"
        allowed = (
            f"allowed are {longest_s:.6g} s, {MAX_STEP_PERIODS} times the median step; "
            f"{counted(gaps.size, 'such gap')} in the file"
        )
        fail(path, index + FIRST_DATA_LINE, what, allowed, "cut the record there, or resample it")


def check_varies(path: Path, name: str, values: FloatArray) -> None:
    """Refuse a column that is the same number throughout.

    Args:
        path: The file, for the message.
        name: Name of the column.
        values: Its values, shape (n_samples,), at least one.

    Raises:
        DataError: If all values are equal.
    """
    if np.ptp(values) == 0:
        what = f"{name} is {values[0]} in all {counted(values.size, 'sample')}"
        remedy = "check the cable and the channel, and record again"
        fail(path, FIRST_DATA_LINE, what, "allowed is a signal that varies", remedy)


def counted(number: int, one: str) -> str:
    """Return a number with what is counted, in the plural where there is not one of it.

    Args:
        number: How many there are.
        one: What a single one is called.
    """
    return f"{number} {one}" if number == 1 else f"{number} {one}s"


def fail(path: Path, line: int, what: str, allowed: str, remedy: str) -> NoReturn:
    """Raise what is wrong in a file, as one line that an editor can jump to.

    Args:
        path: The file.
        line: Line, counted from 1.
        what: What is wrong and what was found.
        allowed: What is allowed.
        remedy: What to do about it.

    Raises:
        DataError: Always.
    """
    raise DataError(f"{path}:{line}: {what}; {allowed}; {remedy}")
