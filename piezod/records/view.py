"""Extremes of a column of a recording per bucket of time, for viewers: no sample is hidden."""

from functools import lru_cache
from math import inf
from pathlib import Path
from threading import Lock
from typing import Any, Final, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from piezod.errors import DataError
from piezod.reading.opened import damage_is_an_error, open_recording
from piezod.records.frozen import FloatArray
from piezod.records.nexus import CHUNK_CACHE_BYTES
from piezod.records.recording.layout import check_time, stage_entry

_TIME: Final = "cycles/t_s"
_BLOCK_ROWS: Final = 16
"""Smallest number of rows whose extremes are remembered together."""
_MAX_BLOCKS: Final = 2**18
"""Largest number of blocks of a column: 4 MB, whatever the length of the recording."""
_BLOCKS_PER_BUCKET: Final = 4
"""A bucket with fewer blocks is made from the rows themselves."""
_READ_ROWS: Final = 2**18
"""Rows that one read takes at most: 2 MB of a column."""
_OPEN_FILES: Final = 4


class MinMax(NamedTuple):
    """Extremes of a column in consecutive buckets; each array has the shape (n_buckets,).

    A bucket without a row, as in a gap of the recording, is left out.
    """

    begin_s: FloatArray  #: Instant of the first row of each bucket, in s.
    end_s: FloatArray  #: Instant of the last row of each bucket, in s.
    #: Smallest valid value, in the unit of the column; NaN if no value is valid.
    minimum: NDArray[Any]
    maximum: NDArray[Any]  #: Largest valid value, likewise.
    rows: NDArray[np.int64]  #: Number of rows.
    valid: NDArray[np.int64]  #: Number of rows whose value is not NaN.


class _Extremes(NamedTuple):
    """Extremes of consecutive rows or blocks: each array has the shape (n,)."""

    minimum: NDArray[Any]
    maximum: NDArray[Any]
    rows: NDArray[np.int64]
    valid: NDArray[np.int64]

    def of(self, starts: NDArray[np.intp]) -> "_Extremes":
        """Return the extremes of the parts that begin at some indices."""
        # fmin and fmax ignore NaN; of integers they are the minimum and the maximum.
        return _Extremes(
            np.fmin.reduceat(self.minimum, starts),
            np.fmax.reduceat(self.maximum, starts),
            np.add.reduceat(self.rows, starts),
            np.add.reduceat(self.valid, starts),
        )

    def part(self, begin: int, end: int) -> "_Extremes":
        """Return a slice of them."""
        return _Extremes(*(each[begin:end] for each in self))


class RecordingView:
    """An open recording, which may still grow, and the extremes of the columns seen so far.

    The first view of a column reads all of it, in portions. Later views of long spans need only
    its extremes per block, at most 4 MB. May be used by several threads.

    Raises:
        DataError: If the file is not a recording of a stage.
        OSError: If it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._file = open_recording(path, rdcc_nbytes=CHUNK_CACHE_BYTES)
        self._path = path
        try:
            with damage_is_an_error(path):
                self._entry = stage_entry(self._file)
        except DataError:
            self._file.close()
            raise
        self._block_rows = _BLOCK_ROWS
        self._blocks: dict[str, _Extremes] = {}
        self._lock = Lock()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def view(
        self, column: str, begin_s: float = -inf, end_s: float = inf, points: int = 2000
    ) -> MinMax:
        """Return the extremes of a column in buckets of about equal time.

        Args:
            column: A column of the cycles or of an axis, as in "axis_x/position_um".
            begin_s: Begin of the span, in s.
            end_s: End of the span, exclusive, in s.
            points: Largest number of buckets, from 1.

        Raises:
            DataError: If there is no such column.
            ValueError: If `points` is below 1.
        """
        if points < 1:
            raise ValueError(f"points must be 1 or more (got {points})")
        with self._lock, damage_is_an_error(self._path):
            values, time = self._column(column), self._column(_TIME)
            values.refresh()
            time.refresh()
            # A write in progress leaves columns of different lengths.
            n_rows = min(len(values), len(time))
            self._fit_blocks(n_rows)
            begin, end = (self._row_at(time, n_rows, instant_s) for instant_s in (begin_s, end_s))
            instants = self._pieces(_TIME, time, begin, end, points)
            pieces = self._pieces(column, values, begin, end, points)
            check_time(instants.minimum)
            check_time(instants.maximum)
        return _buckets(instants, pieces, points)

    def _column(self, name: str) -> h5py.Dataset:
        group, _, _ = name.partition("/")
        dataset = self._entry.get(name)
        if not (
            (group == "cycles" or group.startswith("axis_"))
            and isinstance(dataset, h5py.Dataset)
            and dataset.ndim == 1
        ):
            what = f"{self._path}: no column {name!r}; allowed are such as 'axis_x/position_um'"
            raise DataError(f"{what}; the columns are those of `cycles` and of each `axis_NAME`")
        return dataset

    def _fit_blocks(self, n_rows: int) -> None:
        """Make the blocks longer, if a column would have too many of them."""
        rows = self._block_rows
        while n_rows > rows * _MAX_BLOCKS:
            rows *= 2
        if rows != self._block_rows:
            self._block_rows, self._blocks = rows, {}

    def _row_at(self, time: h5py.Dataset, n_rows: int, instant_s: float) -> int:
        """Return the index of the first row at or after an instant."""
        block = int(np.searchsorted(self._extremes(_TIME, time, n_rows).maximum, instant_s))
        start = block * self._block_rows
        inside_s = time[start : min(start + self._block_rows, n_rows)]
        # More rows of the time may be known than this column has.
        return min(start + int(np.searchsorted(inside_s, instant_s)), n_rows)

    def _pieces(
        self, name: str, dataset: h5py.Dataset, begin: int, end: int, points: int
    ) -> _Extremes:
        """Return the extremes of rows or blocks that together are the rows of a span."""
        rows = self._block_rows
        first, last = -(-begin // rows), end // rows
        if end - begin <= points * rows * _BLOCKS_PER_BUCKET or first >= last:
            return _of_rows(dataset[begin:end])
        # The blocks at both ends are not whole: their rows stand for themselves.
        head, tail = dataset[begin : first * rows], dataset[last * rows : end]
        blocks = self._extremes(name, dataset, end).part(first, last)
        return _joined([_of_rows(head), blocks, _of_rows(tail)])

    def _extremes(self, name: str, dataset: h5py.Dataset, n_rows: int) -> _Extremes:
        """Return the extremes of the whole blocks of a column; read only the new ones."""
        rows = self._block_rows
        known = self._blocks.get(name)
        begin, end = (0 if known is None else known.rows.size) * rows, n_rows // rows * rows
        if known is not None and begin >= end:
            return known
        found = [] if known is None else [known]
        for start in range(begin, max(end, 1), _READ_ROWS):  # at least once, for the types
            portion = _of_rows(dataset[start : min(start + _READ_ROWS, end)])
            found.append(portion.of(np.arange(0, portion.rows.size, rows)))
        self._blocks[name] = _joined(found)
        return self._blocks[name]


def view(
    path: Path, column: str, begin_s: float = -inf, end_s: float = inf, points: int = 2000
) -> MinMax:
    """Return the extremes of a column of a recording, as `RecordingView.view` does.

    The last four files stay open, with what is known about them.

    Args:
        path: Path of the file; it may still grow.
        column: A column of the cycles or of an axis, as in "axis_x/position_um".
        begin_s: Begin of the span, in s.
        end_s: End of the span, exclusive, in s.
        points: Largest number of buckets, from 1.

    Raises:
        DataError: If the file is not a recording of a stage, or has no such column.
        OSError: If it cannot be opened.
        ValueError: If `points` is below 1.
    """
    status = path.stat()
    opened = _opened(path, status.st_dev, status.st_ino)
    return opened.view(column, begin_s, end_s, points)


@lru_cache(maxsize=_OPEN_FILES)
def _opened(path: Path, _device: int, _inode: int) -> RecordingView:
    # Device and inode tell a new file of the same name from the one that is open.
    return RecordingView(path)


def _of_rows(values: NDArray[Any]) -> _Extremes:
    if values.dtype.kind == "b":
        values = values.view(np.uint8)
    valid = values == values  # noqa: PLR0124 - False for NaN, of numbers of any kind
    return _Extremes(values, values, np.ones(values.size, np.int64), valid.astype(np.int64))


def _joined(parts: list[_Extremes]) -> _Extremes:
    return _Extremes(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _buckets(time: _Extremes, values: _Extremes, points: int) -> MinMax:
    """Return the pieces of a span, gathered in buckets of equal time."""
    begins_s = time.minimum
    if not begins_s.size:
        return MinMax(begins_s, begins_s, *values)
    total_s = float(time.maximum[-1] - begins_s[0])
    shares = (begins_s - begins_s[0]) / total_s if total_s else np.zeros(begins_s.size)
    places = np.minimum((shares * points).astype(np.int64), points - 1)
    starts = np.flatnonzero(np.diff(places, prepend=-1))
    instants = time.of(starts)
    return MinMax(instants.minimum, instants.maximum, *values.of(starts))
