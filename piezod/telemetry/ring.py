"""The records of the newest cycles: one writer that never waits, readers that cannot disturb it.

A record has its sequence number at both ends. The number of the newest complete record is a word of
its own. The writer overwrites the oldest record. A reader copies first and then checks that word
again: it drops and counts every record that may have been overwritten meanwhile. This requires that
stores and loads are seen in order. x86-64 guarantees that, and the tests run there.
"""

from collections.abc import Sequence
from struct import Struct
from typing import Any, Final, TypeAlias

from piezod.telemetry.layout import AXIS_FIELDS, CYCLE_FIELDS, Field, body_format, record_bytes
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word

Record: TypeAlias = dict[str, Any]
"""The fields of a cycle by name; `axes` has those of each axis."""


_NEWEST_RECORD: Final = int(Word.NEWEST_RECORD)


class RingWriter:
    """Appends one record per cycle.

    Args:
        shared: The memory; this is the only writer of its ring.
    """

    def __init__(self, shared: SharedMap) -> None:
        axes = len(shared.layout.axes)
        self._capacity = shared.layout.capacity
        self._size = record_bytes(axes)
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
        self._words[_NEWEST_RECORD] = seq
        return seq


class RecordReader:
    """Reads the newest records one by one; `arrays.RingReader` reads many, with numpy."""

    def __init__(self, shared: SharedMap) -> None:
        self._axes = len(shared.layout.axes)
        self._size, self._capacity = record_bytes(self._axes), shared.layout.capacity
        self._body = Struct(body_format(self._axes))
        self._bytes, self._words = shared.part("ring"), shared.words

    def latest(self) -> Record | None:
        """Return the newest record, None before the first."""
        records = self.last(1)
        return records[0] if records else None

    def last(self, count: int) -> list[Record]:
        """Return the newest records, at most `count`, oldest first."""
        newest = self._words[Word.NEWEST_RECORD]
        first = max(newest - min(count, self._capacity - 1), 0) + 1
        found = [self._copy(seq) for seq in range(first, newest + 1)]
        return [record for record in found if record is not None]

    def _copy(self, seq: int) -> Record | None:
        """Return a copy of a record; None if it is being overwritten."""
        at = seq % self._capacity * self._size
        block = bytes(self._bytes[at : at + self._size])
        # The writer may be at the next record, whose slot holds the record one ring older.
        overwritten = seq <= self._words[Word.NEWEST_RECORD] + 1 - self._capacity
        begin, end = int.from_bytes(block[:8], "little"), int.from_bytes(block[-8:], "little")
        if overwritten or not begin == end == seq:
            return None
        values = self._body.unpack_from(block, 8)
        axes = values[len(_CYCLE) :]
        width = len(_AXIS)
        parts = [axes[i * width : (i + 1) * width] for i in range(self._axes)]
        return {
            "seq": seq,
            **dict(zip(_CYCLE, values, strict=False)),
            "axes": [dict(zip(_AXIS, part, strict=True)) for part in parts],
        }


def _names(fields: Sequence[Field]) -> list[str]:
    """Return the names of the fields that have a value."""
    return [field.name for field in fields if not field.code.endswith("x")]


_CYCLE, _AXIS = _names(CYCLE_FIELDS), _names(AXIS_FIELDS)
