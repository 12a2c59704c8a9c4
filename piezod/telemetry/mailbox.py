"""Requests from the supervisor to the loop, and their answers.

There are two bounded lanes, each with one writer and one reader that never wait for each other. The
urgent lane is for requests that must not queue behind others (stop, hold), the ordinary lane for
all others. The loop takes one request per cycle, urgent ones first. An emergency stop uses no lane:
it is a level, so that there is room for it however many requests wait. All share one sequence of
numbers, by which the answer is found.
"""

from struct import Struct
from typing import Final, NamedTuple

from piezod.errors import PiezodError
from piezod.telemetry.layout import (
    ANSWER_BYTES,
    ANSWER_SLOTS,
    REQUEST_BYTES,
    REQUEST_SLOTS,
    SLOT_HEADER,
    URGENT_BYTES,
    URGENT_SLOTS,
)
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word

_REQUEST: Final = Struct("<qqq")  # number, instant of expiry, length of the payload
_ANSWER: Final = Struct("<qqdq")  # accepted, motion, duration, length of the text
_ANSWER_AT: Final = 8  # after the number, which is stored by itself
_ESTOP_ASKED: Final = int(Word.ESTOP_ASKED)
_ESTOP_DONE: Final = int(Word.ESTOP_DONE)
_URGENT: Final = int(Word.URGENT_POSTED)
_ORDINARY: Final = int(Word.REQUESTS_POSTED)
EXPIRED: Final = "expired: the loop did not take it in time"


class MailboxFullError(PiezodError):
    """Raised when the loop has not yet taken earlier requests, or when a request is too large."""


class MailboxAnswer(NamedTuple):
    """Answer to a request, with the fields of `control.stage.answer.Answer`."""

    accepted: bool
    why: str
    motion: int
    duration_s: float


class _Lane:
    """A row of slots, and the words that count posted and taken requests."""

    def __init__(self, shared: SharedMap, name: str, slots: int, size: int, posted: Word) -> None:
        self.name, self.slots, self.size = name, slots, size
        self._bytes, self._words = shared.part(name), shared.words
        self._posted, self._taken = int(posted), int(posted) + 1

    @property
    def waiting(self) -> int:
        return self._words[self._posted] - self._words[self._taken]

    def put(self, number: int, payload: bytes, expires_ns: int) -> None:
        posted = self._words[self._posted]
        at = posted % self.slots * (SLOT_HEADER + self.size)
        _REQUEST.pack_into(self._bytes, at, number, expires_ns, len(payload))
        at += SLOT_HEADER
        # The payload must be complete before the count makes it visible to the reader.
        self._bytes[at : at + len(payload)] = payload
        self._words[self._posted] = posted + 1

    def get(self) -> tuple[int, int, bytes]:
        taken = self._words[self._taken]
        at = taken % self.slots * (SLOT_HEADER + self.size)
        number, expires_ns, length = _REQUEST.unpack_from(self._bytes, at)
        at += SLOT_HEADER
        payload = bytes(self._bytes[at : at + length])
        self._words[self._taken] = taken + 1
        return number, expires_ns, payload


def _lanes(shared: SharedMap) -> tuple[_Lane, _Lane]:
    return (
        _Lane(shared, "urgent", URGENT_SLOTS, URGENT_BYTES, Word.URGENT_POSTED),
        _Lane(shared, "requests", REQUEST_SLOTS, REQUEST_BYTES, Word.REQUESTS_POSTED),
    )


class MailboxWriter:
    """End of the supervisor.

    Args:
        shared: The memory, writable; it has one writer.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._urgent, self._ordinary = _lanes(shared)
        self._answers = shared.part("answers")
        self._numbers = self._answers.cast("q")
        self._words = shared.words

    def post(self, payload: bytes, expires_ns: int, *, urgent: bool = False) -> int:
        """Post a request without waiting.

        Args:
            payload: Result of `requests_codec.encode`.
            expires_ns: Instant until which the loop may take it, in ns.
            urgent: Whether it goes before all other waiting requests; at most 1 KiB.

        Returns:
            Number of the request, for `answer`; the first is 1.

        Raises:
            MailboxFullError: If too many requests wait, or if the request is too large.
        """
        lane = self._urgent if urgent else self._ordinary
        if len(payload) > lane.size:
            what = f"a request of {len(payload)} bytes is too large, at most {lane.size} bytes"
            raise MailboxFullError(f"{what}; send fewer points")
        if lane.waiting >= lane.slots:
            raise MailboxFullError(f"{lane.slots} requests wait for the loop already; try later")
        number = self._next()
        lane.put(number, payload, expires_ns)
        return number

    def post_estop(self) -> int:
        """Request an emergency stop; it is never refused and does not expire.

        Returns:
            Number of the stop, for `estop_answer`.
        """
        number = self._next()
        self._words[Word.ESTOP_ASKED] = number
        return number

    def estop_answer(self, number: int) -> MailboxAnswer | None:
        """Return the answer to an emergency stop, or to a later one."""
        done = self._words[Word.ESTOP_DONE]
        return self.answer(done) if done >= number else None

    def answer(self, number: int) -> MailboxAnswer | None:
        """Return the answer to a request, None while it is open.

        Answers to the newest 64 requests are kept.
        """
        at = number % ANSWER_SLOTS * (SLOT_HEADER + ANSWER_BYTES)
        if self._numbers[at >> 3] != number:
            return None
        accepted, motion, duration_s, length = _ANSWER.unpack_from(self._answers, at + _ANSWER_AT)
        start = at + SLOT_HEADER
        text = bytes(self._answers[start : start + length])
        return MailboxAnswer(bool(accepted), text.decode(errors="ignore"), motion, duration_s)

    def _next(self) -> int:
        self._words[Word.NEWEST_REQUEST] += 1
        return self._words[Word.NEWEST_REQUEST]


class MailboxReader:
    """End of the loop. All methods are real-time safe.

    Args:
        shared: The memory, writable; it has one reader.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._lanes = _lanes(shared)
        self._words = shared.words
        self._answers = shared.part("answers")
        self._numbers = self._answers.cast("q")

    def take(self, now_ns: int) -> tuple[int, bytes] | None:
        """Take the next request that has not expired, as number and payload; None if none waits."""
        words = self._words
        if words[_URGENT] == words[_URGENT + 1] and words[_ORDINARY] == words[_ORDINARY + 1]:
            return None  # as many were taken as were posted
        for lane in self._lanes:
            # Expired requests are answered and skipped; the loop never runs more than one per
            # cycle.
            while lane.waiting:
                number, expires_ns, payload = lane.get()
                if now_ns <= expires_ns:
                    return number, payload
                self._words[Word.REQUESTS_EXPIRED] += 1
                self.answer(number, accepted=False, why=EXPIRED)
        return None

    def take_estop(self) -> int:
        """Return the number of a requested emergency stop, 0 if none is open."""
        asked = self._words[_ESTOP_ASKED]
        # A level, not a queue: one run answers all stops that were requested before it.
        return 0 if asked == self._words[_ESTOP_DONE] else asked

    def answer_estop(
        self, number: int, *, accepted: bool, why: str, motion: int = 0, duration_s: float = 0.0
    ) -> None:
        """Answer an emergency stop, and close it; arguments as for `answer`."""
        self.answer(number, accepted=accepted, why=why, motion=motion, duration_s=duration_s)
        self._words[_ESTOP_DONE] = number

    def answer(
        self, number: int, *, accepted: bool, why: str, motion: int = 0, duration_s: float = 0.0
    ) -> None:
        """Answer a request; a long text is cut off."""
        text = why.encode()[:ANSWER_BYTES]
        at = number % ANSWER_SLOTS * (SLOT_HEADER + ANSWER_BYTES)
        # The number is cleared first and written last, so that no reader takes half an answer.
        self._numbers[at >> 3] = 0
        _ANSWER.pack_into(self._answers, at + _ANSWER_AT, accepted, motion, duration_s, len(text))
        start = at + SLOT_HEADER
        self._answers[start : start + len(text)] = text
        self._numbers[at >> 3] = number
