"""Frames as text, and the slcan adapter."""

import re
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.frame import EXTENDED_IDS, STANDARD_IDS, Frame
from piezod_drivers.can_bus.slcan_bus import SlcanBus
from piezod_drivers.can_bus.slcan_codec import BEL, SlcanLines, decode, encode
from tests.drivers.can_bus.slcan_adapter import QueueingAdapter
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime

DATA = st.binary(max_size=8)
FRAMES = st.one_of(
    st.builds(Frame, st.integers(0, STANDARD_IDS - 1), DATA, st.just(False), st.just(False)),
    st.builds(Frame, st.integers(0, EXTENDED_IDS - 1), DATA, st.just(True), st.just(False)),
    st.builds(
        Frame,
        st.integers(0, EXTENDED_IDS - 1),
        st.sampled_from([bytes(n) for n in range(9)]),
        st.just(True),
        st.just(True),
    ),
)
A, B = Frame(0x305, b"\x01\x02"), Frame(0x80)


@given(FRAMES)
def test_frame_survives_as_text(frame: Frame) -> None:
    """An encoded frame decodes to the same frame."""
    assert decode(encode(frame)[:-1]) == frame


def test_frames_are_written_as_adapters_do() -> None:
    """Identifier, length and bytes follow the letter of the frame type."""
    assert encode(A) == b"t30520102\r"
    assert encode(Frame(0x1ABCDEF0, b"\xff", extended=True)) == b"T1ABCDEF01ff\r"
    assert decode(b"t12320A0b") == Frame(0x123, b"\x0a\x0b")
    assert decode(b"t12320A0BFFFF") == Frame(0x123, b"\x0a\x0b"), "with a time stamp"
    assert decode(b"r1234") == Frame(0x123, bytes(4), remote=True)


@given(
    st.one_of(st.binary(max_size=40), st.from_regex(rb"[tTrR][0-9A-Fa-f ]{0,30}", fullmatch=True))
)
def test_decoding_never_raises(line: bytes) -> None:
    """Decoding any bytes gives a possible frame or None."""
    frame = decode(line)
    if frame is not None:
        assert 0 <= frame.id < (EXTENDED_IDS if frame.extended else STANDARD_IDS)
        assert len(frame.data) <= 8


KIND = re.compile(rb"(?:[tr]([0-7]HH)|[TR]([01]H{7}))([0-8])(H*)".replace(b"H", b"[0-9A-Fa-f]"))
"""Identifier, length, and data with or without a time stamp."""


def _told(line: bytes) -> Frame | None:
    if (match := KIND.fullmatch(line)) is None:
        return None
    short, long, length, data = match.groups()
    n_bytes, remote = int(length), line[:1] in {b"r", b"R"}
    n_digits = 0 if remote else 2 * n_bytes
    if len(data) not in {n_digits, n_digits + 4}:
        return None
    payload = bytes(n_bytes) if remote else bytes.fromhex(data[:n_digits].decode())
    return Frame(int(short or long, 16), payload, long is not None, remote)


NEARLY = st.one_of(
    st.binary(max_size=40),
    st.from_regex(rb"[tTrR][0-9A-Fa-f]{0,30}", fullmatch=True),
    st.from_regex(rb"[tr][0-8][0-9A-Fa-f]{2}[0-9][0-9A-F]{0,21}", fullmatch=True),
    st.from_regex(rb"[TR][012][0-9A-Fa-f]{7}[0-9][0-9a-f]{0,21}", fullmatch=True),
)


@given(st.one_of(NEARLY, FRAMES.map(lambda frame: encode(frame)[:-1])), st.data())
@example(b"t12", None)
@example(b"T1234567", None)
@example(b"t0x14", None)
@example(b"t1230 1", None)
@example(b"t1_30", None)
@example(b"t+100", None)
def test_lines_are_taken_by_the_rules(line: bytes, data: Any) -> None:
    """A line is a frame only if it has exactly the required digits."""
    assert decode(line) == _told(line)
    if data is not None and line:
        at, byte = data.draw(st.integers(0, len(line))), data.draw(st.binary(max_size=4))
        changed = line[:at] + byte + line[at + 1 :]
        assert decode(changed) == _told(changed)


@given(st.lists(st.binary(max_size=50)), st.integers(0, 40))
def test_lines_do_not_depend_on_how_bytes_come(parts: list[bytes], size: int) -> None:
    """The lines do not depend on how the bytes are split."""
    stream = b"".join(part.replace(b"\r", b"")[:20] + b"\r" for part in parts)
    whole, cut = SlcanLines(), SlcanLines()
    step = size + 1
    pieces = [stream[i : i + step] for i in range(0, len(stream), step)]

    assert whole.feed(stream) == [line for piece in pieces for line in cut.feed(piece)]


def test_memory_is_bounded() -> None:
    """Of bytes without a line end only the last few are kept."""
    lines = SlcanLines()
    lines.feed(b"x" * 1_000_000)

    assert len(lines.feed(b"\r")[0]) <= 32


@pytest.fixture
def behind() -> QueueingAdapter:
    """Return an adapter."""
    return QueueingAdapter()


@pytest.fixture
def line(behind: QueueingAdapter) -> EmulatedLine:
    """Return the line to the adapter."""
    return EmulatedLine(behind, TestTime())


@pytest.fixture
def bus(line: EmulatedLine) -> SlcanBus:
    """Return the open bus behind the adapter."""
    bus = SlcanBus(line, 500_000)
    bus.open(())
    return bus


def test_opening_sets_the_bit_rate(bus: SlcanBus, behind: QueueingAdapter) -> None:
    """Opening closes the channel, sets the bit rate and opens the channel."""
    assert b"".join(behind.commands) == b"\rC\rS6\rO\r"
    bus.open(())
    assert b"".join(behind.commands).endswith(b"\rC\rS6\rO\r")


def test_frames_go_both_ways(bus: SlcanBus, behind: QueueingAdapter, line: EmulatedLine) -> None:
    """Frames pass both ways, and acknowledgements are no frames."""
    bus.send(A)
    line.comes(behind.adapter.give(B) + behind.adapter.give(A))

    assert behind.on_bus == [A]
    assert [bus.receive(MS), bus.receive(0), bus.receive(0)] == [B, A, None]
    assert bus.take_noticed() == set()


def test_nothing_comes_in_time(bus: SlcanBus) -> None:
    """Waiting for a frame ends after the given time."""
    begin_ns = bus.now_ns()

    assert bus.receive(3 * MS) is None
    assert bus.now_ns() - begin_ns == 3 * MS


@pytest.mark.sees("canopen", "B8")
@pytest.mark.sees("can_dbc", "B8")
def test_old_setpoint_never_leaves(bus: SlcanBus, behind: QueueingAdapter) -> None:
    """Opening the bus again discards the frames that the adapter could not send."""
    behind.stuck = True
    bus.send(A)
    assert list(behind.queue) == [A]

    bus.open(())
    behind.stuck = False
    bus.send(B)

    assert behind.on_bus == [B]


def test_old_setpoint_of_another_process_never_leaves(
    behind: QueueingAdapter, line: EmulatedLine
) -> None:
    """Opening also discards frames of a process that died with the channel open."""
    behind.receive(b"O\r")
    behind.stuck = True
    behind.receive(encode(A))
    bus = SlcanBus(line, 500_000)
    bus.open(())
    behind.stuck = False
    bus.send(B)

    assert behind.on_bus == [B]


@pytest.mark.sees("canopen", "B9")
@pytest.mark.sees("can_dbc", "B9")
def test_refused_frame_is_reported(bus: SlcanBus, behind: QueueingAdapter) -> None:
    """After a refused frame the next one fails and is not sent."""
    behind.adapter.off_bus = True
    bus.send(A)
    bus.receive(MS)

    with pytest.raises(LineFault) as failure:
        bus.send(B)
    assert failure.value.flag == DeviceFlag.NOT_SENT
    assert behind.on_bus == []


@pytest.mark.sees("canopen", "B8")
@pytest.mark.sees("can_dbc", "B8")
def test_adapter_that_refuses_again_and_again_is_off_the_bus(
    bus: SlcanBus, behind: QueueingAdapter
) -> None:
    """Three refused frames in a row lose the bus; an accepted frame resets the count."""
    for refused, flag in ((2, DeviceFlag.NOT_SENT), (3, DeviceFlag.BUS_OFF)):
        bus.send(A)
        bus.receive(MS)
        behind.adapter.off_bus = True
        for _ in range(refused):
            bus.send(A)
        behind.adapter.off_bus = False
        bus.receive(MS)
        with pytest.raises(LineFault) as failure:
            bus.send(A)
        assert failure.value.flag == flag


@pytest.mark.sees("canopen", "B3")
@pytest.mark.sees("can_dbc", "B3")
def test_garbage_is_reported(bus: SlcanBus, line: EmulatedLine) -> None:
    """Bytes that are no line of an adapter are reported and hide no frame behind them."""
    line.comes(b"\xff\x00rubbish\rt0800\r")

    assert bus.receive(MS) == B
    assert bus.take_noticed() == {DeviceFlag.GARBAGE}


class _BufferedLine(EmulatedLine):
    """A line that sends only when the caller waits, and drops unsent bytes when closed."""

    def __init__(self, behind: QueueingAdapter) -> None:
        super().__init__(behind, TestTime())
        self._unsent: list[bytes] = []

    def send(self, data: bytes) -> None:
        self._require()
        self._unsent.append(data)

    def receive(self, within_ns: int) -> bytes:
        unsent, self._unsent = self._unsent, []
        for data in unsent:
            super().send(data)
        return super().receive(within_ns)

    def close(self) -> None:
        self._unsent.clear()
        super().close()


@pytest.mark.sees("canopen", "B8")
@pytest.mark.sees("can_dbc", "B8")
def test_closing_closes_the_channel(behind: QueueingAdapter) -> None:
    """The adapter receives the close command before the port is released."""
    line = _BufferedLine(behind)
    bus = SlcanBus(line, 500_000)
    bus.open(())
    behind.stuck = True
    bus.send(A)
    behind.adapter.off_bus = True
    bus.send(A)
    bus.close()

    assert behind.commands[-1] == b"C\r"
    assert not behind.queue
    assert not line.opened


class _SlowLine(EmulatedLine):
    """A line whose replies come late and byte by byte."""

    def comes(self, data: bytes, after_ns: int = 0) -> None:
        for i, byte in enumerate(data):
            super().comes(bytes((byte,)), MS if i else after_ns)


def test_late_adapter_has_refused_nothing(behind: QueueingAdapter) -> None:
    """A late reply to the close command is not taken for a refused frame."""
    bus = SlcanBus(_SlowLine(behind, TestTime(), 200 * MS), 500_000)
    bus.open(())
    for _ in range(5):
        bus.send(A)
        bus.receive(250 * MS)

    assert behind.on_bus == [A] * 5


def test_unplugged_adapter_is_reported(bus: SlcanBus, line: EmulatedLine) -> None:
    """With an unplugged adapter every call fails except closing."""
    line.unplugged = True

    with pytest.raises(LineFault) as failure:
        bus.send(A)
    assert failure.value.flag == DeviceFlag.DISCONNECTED
    with pytest.raises(LineFault) as failure:
        bus.receive(0)
    assert failure.value.flag == DeviceFlag.DISCONNECTED
    bus.close()


def test_adapter_that_acknowledges_nothing_is_used(
    line: EmulatedLine, behind: QueueingAdapter
) -> None:
    """An adapter that never acknowledges can be opened."""
    behind.silent = True
    bus = SlcanBus(line, 500_000)
    bus.open(())
    bus.send(A)

    assert behind.on_bus == [A]


def test_adapter_that_refuses_is_not_used(line: EmulatedLine) -> None:
    """An adapter that refuses the bit rate is refused with the reason."""
    line.change = lambda reply: BEL if reply == b"\r" else reply
    bus = SlcanBus(line, 125_000)

    with pytest.raises(DeviceUnavailableError, match="refuses a bit rate of 125000 bit/s"):
        bus.open(())
    assert not line.opened
