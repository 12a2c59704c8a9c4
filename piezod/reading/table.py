"""A table of numbers in a file, of which only the columns that are needed are read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.errors import DataError

FloatArray: TypeAlias = npt.NDArray[np.float64]

MOST_BYTES: Final = 512_000_000
"""Largest size of a file but HDF5: as text 20 million samples of a usual record."""
MOST_VALUES: Final = 200_000_000
"""Most numbers of an array that are read at once."""
MOST_COLUMNS: Final = 1000


class Column(NamedTuple):
    """A column of a table."""

    name: str  #: As the file has it, without spaces at its ends.
    unit: str = ""  #: What the file says about its unit elsewhere than in the name.
    last: str = ""  #: The last part of a name that is a path; empty for other names.


class Clock(NamedTuple):
    """Evenly spaced times that a file gives by their start and their interval."""

    start_s: float  #: Time of the first sample, in s.
    interval_s: float  #: Time from sample to sample, in s.
    said: str  #: Where the file says so, for people.


@dataclass(frozen=True)
class Table:
    """A table of numbers, with what was understood of its form."""

    path: Path  #: The file, as the user gave it.
    form: str  #: What kind of file it is and how it was read, for people.
    columns: tuple[Column, ...]  #: Its columns; only those with numbers.
    #: Returns columns by their numbers, each of shape (n,), with NaN for empty cells.
    read: Callable[[Sequence[int]], list[FloatArray]]
    clock: Clock | None = None  #: Time that the file gives without a column of it.
    first: int = 1  #: Number of the first sample, as a line or row of the file.
    counted: str = "sample"  #: What samples are in the file: "line", "row" or "sample".
    plain: bool = False  #: Whether it has the form that piezod writes, and needs no explanation.
    #: What was understood while columns were read; grows with `read`.
    found_later: list[str] = field(default_factory=list)

    def place(self, index: int) -> str:
        """Return the place of a sample, as an editor can jump to it if it is a line."""
        number = self.first + index
        if self.counted == "line":
            return f"{self.path}:{number}"
        return f"{self.path}: {self.counted} {number}"


def as_column(values: object, place: str) -> FloatArray:
    """Return an array of a file as double precision of shape (n,).

    Args:
        values: An array of numbers, of which at most one dimension is longer than 1.
        place: Path and name, for the message.

    Raises:
        DataError: If it is no such array.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise DataError(f"{place}: it does not consist of real numbers (but of {array.dtype})")
    return np.ascontiguousarray(array.reshape(-1), dtype=np.float64)


def columns_of_array(name: str, shape: tuple[int, ...]) -> list[tuple[str, int | None]]:
    """Return names and indices of the columns of an array; none if it is no table.

    The longer of two dimensions is that of the samples.

    Args:
        name: Name of the array; its columns get a number behind it.
        shape: Its shape.
    """
    long = [size for size in shape if size > 1]
    if len(long) == 1:
        return [(name, None)]
    if len(shape) == 2 and 0 < min(shape) <= MOST_COLUMNS:
        return [(f"{name}.{number + 1}".lstrip("."), number) for number in range(min(shape))]
    return []


def column_of_array(array: object, number: int | None) -> object:
    """Return a column of an array, by the index that `columns_of_array` gave."""
    values = np.asarray(array)
    if number is None:
        return values
    return values[:, number] if values.shape[0] >= values.shape[1] else values[number]
