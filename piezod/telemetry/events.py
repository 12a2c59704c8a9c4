"""Events of the loop, for log and audit of the supervisor; new events overwrite the oldest."""

from struct import Struct
from typing import Final

from piezod.telemetry.layout import EVENT_BYTES, EVENT_SLOTS
from piezod.telemetry.record import StageEvent
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word

_NUMBERS: Final = Struct("<qddq")  # instant, measured, limit, length of the text
_TEXT_AT: Final = 8 + _NUMBERS.size
_TEXT_BYTES: Final = EVENT_BYTES - _TEXT_AT
_SEPARATOR: Final = "\x1f"


class EventWriter:
    """End of the loop.

    Args:
        shared: The memory, writable; it has one writer.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._bytes, self._words = shared.part("events"), shared.words
        self._numbers = self._bytes.cast("q")
        self._seq = shared.words[Word.NEWEST_EVENT]

    def append(self, event: StageEvent) -> None:
        """Publish an event; a long text is cut off. Real-time safe."""
        t_ns, severity, kind, text, fault, axis, measured, limit = event
        texts = _SEPARATOR.join((severity, kind, fault, axis, text)).encode()[:_TEXT_BYTES]
        self._seq = seq = self._seq + 1
        at = seq % EVENT_SLOTS * EVENT_BYTES
        self._numbers[at >> 3] = seq
        _NUMBERS.pack_into(self._bytes, at + 8, t_ns, measured, limit, len(texts))
        self._bytes[at + _TEXT_AT : at + _TEXT_AT + len(texts)] = texts
        self._words[Word.NEWEST_EVENT] = seq


class EventReader:
    """Follows the events from the present one on; any number of readers is possible."""

    def __init__(self, shared: SharedMap) -> None:
        self._bytes, self._words = shared.part("events"), shared.words
        self._position = self._words[Word.NEWEST_EVENT]

    def read(self) -> tuple[list[StageEvent], int]:
        """Return the events since the last call, oldest first, and the number of lost events."""
        newest = self._words[Word.NEWEST_EVENT]
        start = max(self._position, newest - EVENT_SLOTS + 1)
        copied = [(seq, self._copy(seq)) for seq in range(start + 1, newest + 1)]
        # The writer may be at the next event, whose slot holds the event that is one turn older.
        oldest = self._words[Word.NEWEST_EVENT] + 2 - EVENT_SLOTS
        events = [_event(slot) for seq, slot in copied if seq >= oldest]
        lost = newest - self._position - len(events)
        self._position = newest
        return events, lost

    def _copy(self, seq: int) -> bytes:
        at = seq % EVENT_SLOTS * EVENT_BYTES
        return bytes(self._bytes[at : at + EVENT_BYTES])


def _event(slot: bytes) -> StageEvent:
    t_ns, measured, limit, length = _NUMBERS.unpack_from(slot, 8)
    text = slot[_TEXT_AT : _TEXT_AT + length].decode(errors="ignore")
    severity, kind, fault, axis, text = text.split(_SEPARATOR, 4)
    return StageEvent(t_ns, severity, kind, text, fault, axis, measured, limit)
