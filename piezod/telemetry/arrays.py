"""The records of the ring as arrays of numpy, for readers of many records.

A module of its own: the supervisor imports it, and with it numpy (12 MB), when somebody records, or
asks for telemetry.
"""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from piezod.telemetry.layout import AXIS_FIELDS, CYCLE_FIELDS
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word

Records: TypeAlias = NDArray[Any]
"""Records of `record_dtype`, shape (n,)."""


def record_dtype(axes: int) -> np.dtype[np.void]:
    """Return the numpy type of a record; the field `axes` has shape (axes,)."""
    axis = np.dtype([(name, dtype) for name, dtype, _ in AXIS_FIELDS])
    cycle = [(name, dtype) for name, dtype, _ in CYCLE_FIELDS]
    return np.dtype([("seq", "<i8"), *cycle, ("axes", axis, (axes,)), ("end_seq", "<i8")])


class RingReader:
    """Follows the ring from its present position; any number of readers is possible."""

    def __init__(self, shared: SharedMap) -> None:
        self._words = shared.words
        self._ring = np.frombuffer(shared.part("ring"), record_dtype(len(shared.layout.axes)))
        self._capacity = shared.layout.capacity
        self._position = self.newest

    @property
    def newest(self) -> int:
        """Sequence number of the newest record; 0 before the first."""
        return self._words[Word.NEWEST_RECORD]

    def last(self, count: int) -> Records:
        """Return up to `count` of the newest records, oldest first; the position stays."""
        newest = self.newest
        return self._copy(max(newest - count, 0), newest)

    def read(self, limit: int) -> tuple[Records, int]:
        """Return the records since the last call, oldest first.

        Args:
            limit: Largest number of records; the others come with the next call.

        Returns:
            The records, and the number of records that were lost before or among them.
        """
        newest = self.newest
        start = max(self._position, newest - self._capacity + 1)
        end = min(start + limit, newest)
        records = self._copy(start, end)
        lost = end - self._position - len(records)
        self._position = end
        return records, lost

    def _copy(self, after: int, until: int) -> Records:
        """Return copies of the complete records after one sequence number up to another."""
        # Older records have been overwritten already.
        after = max(after, until - self._capacity + 1)
        seqs = np.arange(after + 1, until + 1)
        records = self._ring[seqs % self._capacity]
        complete = (records["seq"] == seqs) & (records["end_seq"] == seqs)
        # The writer may be at the next record, whose slot holds the record that is one ring older.
        complete &= seqs > self.newest + 1 - self._capacity
        return records if complete.all() else records[complete]
