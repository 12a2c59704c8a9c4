"""Requests and replies; a late reply is never taken for the next one."""

from collections.abc import Sequence
from contextlib import suppress
from threading import Event, Thread
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.conversation import MOST_BYTES, PATIENCE, Conversation
from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from tests.daemon.waiting import join
from tests.devices.bus.played_line import MS, PlayedLine

TIMEOUT_MS = 20


def lines(got: bytes) -> int:
    """Find lines; bytes that do not begin with a digit or `>` are garbage."""
    if got and not (got[:1].isdigit() or got[:1] == b">"):
        return -1
    return got.find(b"\n") + 1


def talk(line: PlayedLine) -> Conversation:
    """Return a conversation with a time-out of 20 ms."""
    return Conversation(line, TIMEOUT_MS * 1e-3)


def flag_of(conversation: Conversation, request: bytes = b"1") -> DeviceFlag:
    """Return the flag of a failing request."""
    with pytest.raises(LineFault) as fault:
        conversation.ask(request, lines)
    return fault.value.flag


def test_reply_is_the_first_frame() -> None:
    """The reply may arrive in pieces and after garbage."""
    line = PlayedLine(lambda _: [(MS, b"#!1"), (2 * MS, b"2"), (3 * MS, b"3\n")])
    conversation = talk(line)

    assert conversation.ask(b"?", lines) == b"123\n"
    assert conversation.take_noticed() == {DeviceFlag.GARBAGE}
    assert conversation.take_noticed() == set()


def test_slow_reply_is_noticed() -> None:
    """A reply that takes most of its time-out sets the flag."""
    line = PlayedLine(lambda _: [(17 * MS, b"1\n")])
    conversation = talk(line)
    conversation.ask(b"?", lines)

    assert conversation.take_noticed() == {DeviceFlag.SLOW_REPLY}


def test_line_notices_too() -> None:
    """Faults of the line are reported with the others."""
    line = PlayedLine()
    line.noticed.add(DeviceFlag.OTHER_PATH)

    assert talk(line).take_noticed() == {DeviceFlag.OTHER_PATH}


def test_second_frame_is_dropped() -> None:
    """A repeated reply is out of order, and not the reply to the next request."""
    line = PlayedLine(lambda request: [(MS, request + b"\n" + request + b"\n")])
    conversation = talk(line)

    assert [conversation.ask(b"%d" % k, lines) for k in range(3)] == [b"0\n", b"1\n", b"2\n"]
    assert conversation.take_noticed() == {DeviceFlag.OUT_OF_ORDER}


def test_unsolicited_bytes_are_dropped() -> None:
    """Bytes that arrive just before the request is sent are dropped."""
    line = PlayedLine(lambda _: [(MS, b"2\n")])
    conversation = talk(line)
    line.comes(b"1\n")

    assert conversation.ask(b"?", lines) == b"2\n"
    assert conversation.take_noticed() == {DeviceFlag.OUT_OF_ORDER}


def test_endless_garbage_is_bounded() -> None:
    """A device that sends garbage for a whole time-out uses bounded memory."""
    line = PlayedLine(lambda _: [(k * MS, b"1" * MOST_BYTES) for k in range(1, TIMEOUT_MS)])
    conversation = talk(line)

    assert flag_of(conversation) == DeviceFlag.LATE_REPLY
    assert conversation.take_noticed() == {DeviceFlag.GARBAGE}


def test_nothing_is_asked_while_a_late_reply_may_come() -> None:
    """Until the end of `PATIENCE` nothing is sent; then the next request is."""
    line = PlayedLine()
    conversation = talk(line)
    flag_of(conversation)
    flags = []
    for _ in range(PATIENCE * TIMEOUT_MS - 1):
        line.t_ns += MS
        flags.append(flag_of(conversation))
        with pytest.raises(LineFault):
            conversation.tell(b"told")
    sent_before = line.sent.copy()
    line.t_ns += MS
    flag_of(conversation, b"2")

    assert set(flags) == {DeviceFlag.LATE_REPLY}
    assert (sent_before, line.sent) == ([b"1"], [b"1", b"2"])


@pytest.mark.parametrize("early_ns", [0, 1])
def test_reply_at_the_end_of_patience(early_ns: int) -> None:
    """A reply at the last instant, or just before, is still recognised as late."""
    late_ns = (1 + PATIENCE) * TIMEOUT_MS * MS - early_ns
    line = PlayedLine(
        lambda request: [(late_ns if request == b"1" else MS, request + b"\n")],
    )
    conversation = talk(line)
    flag_of(conversation)
    line.t_ns += PATIENCE * TIMEOUT_MS * MS

    assert conversation.ask(b"2", lines) == b"2\n"
    assert conversation.take_noticed() == {DeviceFlag.LATE_REPLY}


def test_opening_again_does_not_forget_a_late_reply() -> None:
    """A device does not notice that its port was opened again, and answers the old request."""
    line = PlayedLine()
    conversation = talk(line)
    flag_of(conversation)
    conversation.restart()

    assert flag_of(conversation) == DeviceFlag.LATE_REPLY
    assert line.sent == [b"1"]


@pytest.mark.parametrize("comes_ms", [30, 220, None])
def test_late_reply_can_be_waited_for(comes_ms: int | None) -> None:
    """The wait ends when the reply comes or can no longer come; then a request is sent at once."""
    coming = [] if comes_ms is None else [(comes_ms * MS, b"1\n")]
    line = PlayedLine(lambda request: coming if request == b"1" else [(MS, b"2\n")])
    conversation = talk(line)
    flag_of(conversation)
    begin_ns = line.t_ns - TIMEOUT_MS * MS
    conversation.wait_out()
    conversation.wait_out()

    assert (line.t_ns - begin_ns) // MS == (comes_ms or (1 + PATIENCE) * TIMEOUT_MS)
    assert conversation.ask(b"2", lines) == b"2\n"


def test_half_a_reply_is_no_beginning_of_the_next() -> None:
    """After `PATIENCE` the bytes of an incomplete reply are dropped."""
    line = PlayedLine(lambda request: [(MS, b"12" if request == b"1" else b"3\n")])
    conversation = talk(line)
    flag_of(conversation)
    line.t_ns += 11 * TIMEOUT_MS * MS

    assert conversation.ask(b"2", lines) == b"3\n"


def test_tagged_replies_need_no_patience() -> None:
    """If frames carry a tag, the next request is sent at once, and a late reply is dropped."""
    line = PlayedLine(
        lambda request: [((25 if request == b"1" else 2) * MS, b">" + request + b"\n")]
    )
    conversation = talk(line)

    def ask(number: bytes) -> bytes:
        return conversation.ask(number, lines, lambda frame: frame[1:-1] == number)

    with pytest.raises(LineFault):
        ask(b"1")
    line.t_ns += 4 * MS
    assert [ask(b"2"), ask(b"3")] == [b">2\n", b">3\n"]
    assert conversation.take_noticed() == {DeviceFlag.OUT_OF_ORDER}


def test_late_tagged_reply_within_the_time_of_the_next() -> None:
    """A late reply that comes during the next request is not taken for its reply."""
    line = PlayedLine(
        lambda request: [((25 if request == b"1" else 15) * MS, b">" + request + b"\n")]
    )
    conversation = talk(line)
    with pytest.raises(LineFault):
        conversation.ask(b"1", lines, lambda frame: frame == b">1\n")

    assert conversation.ask(b"2", lines, lambda frame: frame == b">2\n") == b">2\n"


def starts_with_digit(frame: bytes) -> bool:
    """Return whether a frame is a reply and not an unsolicited message."""
    return frame[:1].isdigit()


def test_foreign_frame_is_no_reply() -> None:
    """It counts as garbage, and the reply after it is found."""
    line = PlayedLine(lambda _: [(MS, b">warning\n"), (2 * MS, b"1\n")])
    conversation = talk(line)

    assert conversation.ask(b"?", lines, fits=starts_with_digit) == b"1\n"
    assert conversation.take_noticed() == {DeviceFlag.GARBAGE}


@pytest.mark.parametrize("foreign_ms", [1, 25])
def test_foreign_frame_ends_no_waiting(foreign_ms: int) -> None:
    """The reply stays owed, whether the frame came in time or later."""
    line = PlayedLine(
        lambda request: (
            [(foreign_ms * MS, b">warning\n"), (90 * MS, b"1\n")]
            if request == b"1"
            else [(MS, b"2\n")]
        )
    )
    conversation = talk(line)
    with pytest.raises(LineFault):
        conversation.ask(b"1", lines, fits=starts_with_digit)
    line.t_ns += 10 * MS

    with pytest.raises(LineFault, match="may still come"):
        conversation.ask(b"2", lines, fits=starts_with_digit)
    line.t_ns += 65 * MS
    assert conversation.ask(b"2", lines, fits=starts_with_digit) == b"2\n"
    assert conversation.take_noticed() == {DeviceFlag.GARBAGE, DeviceFlag.LATE_REPLY}


def test_foreign_frames_end_with_patience() -> None:
    """After a lost reply, unsolicited frames do not block the next request for longer."""
    line = PlayedLine(lambda request: [(MS, b"2\n")] if request == b"2" else [])
    conversation = talk(line)
    with pytest.raises(LineFault):
        conversation.ask(b"1", lines, fits=starts_with_digit)
    for k in range(20):
        line.comes(b">warning\n", (20 * k - 1) * MS)
    conversation.wait_out()

    assert conversation.ask(b"2", lines, fits=starts_with_digit) == b"2\n"


class Fate(NamedTuple):
    """Fate of a reply."""

    late_ms: int  #: Delay beyond the time-out; below 0 for in time.
    lost: bool  #: Whether it is lost.
    twice: bool  #: Whether it comes twice.
    cut: int  #: Number of its bytes that arrive.
    noise: bytes  #: Bytes before it.
    foreign_ms: Sequence[int]  #: Times after the request at which unsolicited frames come.


FATES = st.builds(
    Fate,
    st.integers(-TIMEOUT_MS + 1, PATIENCE * TIMEOUT_MS) | st.just(-10),
    st.booleans(),
    st.booleans(),
    st.just(100) | st.integers(0, 6),
    st.just(b"") | st.binary(max_size=4),
    st.lists(st.integers(0, 2 * PATIENCE * TIMEOUT_MS), max_size=4),
)


@given(
    fates=st.lists(FATES, max_size=30),
    pauses_ms=st.lists(st.integers(0, 3 * PATIENCE * TIMEOUT_MS), min_size=30, max_size=30),
)
def test_no_fate_makes_a_reply_another_ones(fates: list[Fate], pauses_ms: list[int]) -> None:
    """For any fate, an accepted reply of full length belongs to this very request.

    Unsolicited frames come at any time, also while a late reply is owed.
    """
    line = PlayedLine()
    conversation = talk(line)
    for number, (fate, pause_ms) in enumerate(zip(fates, pauses_ms, strict=False)):
        reply = b"%05d\n" % number
        whole = fate.noise + reply[: fate.cut]
        due_ns = (TIMEOUT_MS + fate.late_ms) * MS
        coming = [] if fate.lost else [(due_ns, whole)] * (2 if fate.twice else 1)
        coming += [(ms * MS, b">warn\n") for ms in fate.foreign_ms]
        line.answer = lambda _, coming=coming: coming  # type: ignore[misc] # a default argument
        try:
            got = conversation.ask(b"?", lines, fits=starts_with_digit)
        except LineFault as fault:
            assert fault.flag == DeviceFlag.LATE_REPLY
        else:
            assert len(got) != 6 or got == reply or fate.noise
        line.t_ns += pause_ms * MS


STEPS = st.tuples(
    st.sampled_from([10]) | st.integers(TIMEOUT_MS + 1, (1 + PATIENCE) * TIMEOUT_MS),
    st.lists(st.integers(0, 60), max_size=2),
    st.integers(0, 40),
)


@given(steps=st.lists(STEPS, min_size=3, max_size=40))
def test_foreign_frames_never_make_a_late_reply_another_ones(
    steps: list[tuple[int, list[int], int]],
) -> None:
    """This holds for late replies, unsolicited frames and quick requests in any order."""
    line = PlayedLine()
    conversation = talk(line)
    for number, (after_ms, foreign_ms, pause_ms) in enumerate(steps):
        reply = b"%d\n" % number
        coming = [(after_ms * MS, reply), *((ms * MS, b">warn\n") for ms in foreign_ms)]
        line.answer = lambda _, coming=coming: coming  # type: ignore[misc] # a default argument
        with suppress(LineFault):
            assert conversation.ask(b"?", lines, fits=starts_with_digit) == reply
        line.t_ns += pause_ms * MS


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (b"", "no reply within 20 ms"),
        (b"#?", "no reply within 20 ms: what came does not fit: '#?' (23 3F)"),
        (b"12", "no reply within 20 ms: what came does not fit: '12' (31 32)"),
    ],
)
def test_missing_reply_says_what_came_instead(answer: bytes, text: str) -> None:
    """The message of a missing reply has the bytes that came instead, as text and as numbers."""
    line = PlayedLine(lambda _: [(MS, answer)] if answer else [])
    with pytest.raises(LineFault) as fault:
        talk(line).ask(b"?", lines)
    assert str(fault.value) == text


def test_dropped_bytes_are_kept_for_a_message() -> None:
    """Bytes before the request and frames that do not fit are kept until the next exchange."""
    line = PlayedLine(lambda _: [(MS, b"7\n1\n")])
    conversation = talk(line)
    line.comes(b"OK\n")
    line.t_ns += MS

    assert conversation.ask(b"?", lines, fits=lambda frame: frame == b"1\n") == b"1\n"
    assert conversation.dropped == b"OK\n7\n"
    line.answer = lambda _: [(MS, b"1\n")]
    assert conversation.ask(b"?", lines) == b"1\n"
    assert conversation.dropped == b""


class HeldLine(PlayedLine):
    """A line that answers when the test lets it."""

    def __init__(self) -> None:
        super().__init__(lambda request: [(MS, request[1:])])
        self.waits, self.free = Event(), Event()

    def receive(self, within_ns: int) -> bytes:
        """Return what has come; if a reply is waited for, wait for the test, too."""
        if within_ns:
            self.waits.set()
            assert self.free.wait(20.0)
        return super().receive(within_ns)


@pytest.mark.parametrize("use", ["ask", "tell", "wait_out"])
def test_a_second_thread_sends_nothing(use: str) -> None:
    """It gets an error with the names of both; the exchange of the first one goes on."""
    line, replies = HeldLine(), list[bytes]()
    conversation = talk(line)
    first = Thread(target=lambda: replies.append(conversation.ask(b"?1\n", lines)), name="first")
    calls = {
        "ask": lambda: conversation.ask(b"?2\n", lines),
        "tell": lambda: conversation.tell(b"!"),
        "wait_out": conversation.wait_out,
    }
    first.start()
    assert line.waits.wait(20.0)
    with pytest.raises(DeviceError, match="MainThread uses the line while thread first waits"):
        calls[use]()
    line.free.set()
    join(first)

    assert replies == [b"1\n"]
    assert line.sent == [b"?1\n"]
    assert conversation.ask(b"?2\n", lines) == b"2\n"
