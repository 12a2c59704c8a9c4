"""The records of the newest cycles: one writer that never waits, readers that cannot disturb it.

A record has its sequence number at both ends. The number of the newest complete record is a word of
its own. The writer overwrites the oldest record. A reader copies first and then checks that word
again: it drops and counts every record that may have been overwritten meanwhile. This requires that
stores and loads are seen in order. x86-64 guarantees that, and the tests run there.
"""

from collections.abc import Sequence
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezod.telemetry.layout import body_format, record_dtype
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word


class RingWriter:
    """Appends one record per cycle.

    Args:
        shared: The memory; this is the only writer of its ring.
    """

    def __init__(self, shared: SharedMap) -> None:
        axes = len(shared.layout.axes)
        self._capacity = shared.layout.capacity
        self._size = record_dtype(axes).itemsize
        self._pack_into = Struct(body_format(axes)).pack_into
        self._bytes = shared.part("ring")
        self._words, self._ring_words = shared.words, self._bytes.cast("q")
        self._seq = shared.words[Word.NEWEST_RECORD]

    def append(self, fields: Sequence[float]) -> int:
        """Write a record. Real-time safe.

        Args:
            fields: Values of `layout.CYCLE_FIELDS`, then of `layout.AXIS_FIELDS` for each axis,
                without the gaps.

        Returns:
            Sequence number of the record.
        """
        self._seq = seq = self._seq + 1
        at = seq % self._capacity * self._size
        begin = at >> 3
        self._ring_words[begin] = seq
        self._pack_into(self._bytes, at + 8, *fields)
        self._ring_words[begin + (self._size >> 3) - 1] = seq
        self._words[Word.NEWEST_RECORD] = seq
        return seq


class RingReader:
    """Follows the ring from its present position; any number of readers is possible.

    Args:
        shared: The memory.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._words = shared.words
        self._ring = shared.array("ring", record_dtype(len(shared.layout.axes)))
        self._capacity = shared.layout.capacity
        self._position = self.newest

    @property
    def newest(self) -> int:
        """Sequence number of the newest record; 0 before the first."""
        return self._words[Word.NEWEST_RECORD]

    def latest(self) -> np.void | None:
        """Return the newest record, None before the first."""
        records = self.last(1)
        latest: np.void | None = records[-1] if len(records) else None
        return latest

    def last(self, count: int) -> NDArray[Any]:
        """Return up to `count` of the newest records, oldest first; the position stays."""
        newest = self.newest
        return self._copy(max(newest - count, 0), newest)

    def read(self, limit: int) -> tuple[NDArray[Any], int]:
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

    def _copy(self, after: int, until: int) -> NDArray[Any]:
        """Return copies of the complete records after one sequence number up to another."""
        # Older records have been overwritten already.
        after = max(after, until - self._capacity + 1)
        seqs = np.arange(after + 1, until + 1)
        records = self._ring[seqs % self._capacity]
        complete = (records["seq"] == seqs) & (records["end_seq"] == seqs)
        # The writer may be at the next record, whose slot holds the record that is one ring older.
        complete &= seqs > self.newest + 1 - self._capacity
        return records if complete.all() else records[complete]
