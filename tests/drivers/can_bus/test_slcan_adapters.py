"""The slcan bus with adapters that differ in spelling, echo and start."""

import re
from collections.abc import Callable

import pytest

from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.slcan_bus import SlcanBus
from piezod_drivers.can_bus.slcan_codec import encode
from tests.drivers.can_bus.slcan_adapter import QueueingAdapter
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime

A, B = Frame(0x305, b"\x01\x02"), Frame(0x80)


@pytest.fixture
def behind() -> QueueingAdapter:
    """Return an adapter."""
    return QueueingAdapter()


@pytest.fixture
def line(behind: QueueingAdapter) -> EmulatedLine:
    """Return the line to the adapter."""
    return EmulatedLine(behind, TestTime())


@pytest.mark.parametrize(
    "spell",
    [
        lambda reply: reply.replace(b"\r", b"\r\n"),
        bytes.upper,
        bytes.lower,
        lambda reply: reply.replace(b"z\r", b"\r").replace(b"Z\r", b"\r"),
        lambda reply: re.sub(rb"(t[^\r]+)", rb"\g<1>1234", reply),
    ],
    ids=["CR LF", "upper case", "lower case", "plain acknowledgement", "time stamps"],
)
def test_spellings_of_adapters(
    line: EmulatedLine, behind: QueueingAdapter, spell: Callable[[bytes], bytes]
) -> None:
    """Frames pass both ways, and no spelling of an adapter is garbage."""
    line.change = spell
    bus = SlcanBus(line, 500_000)
    begin_ns = line.now_ns()
    bus.open(())
    took_ns = line.now_ns() - begin_ns
    bus.send(A)
    line.comes(spell(behind.adapter.give(B)) if spell is not bytes.upper else b"t0800\r")

    assert behind.on_bus == [A]
    assert [bus.receive(MS), bus.receive(MS)] == [B, None]
    assert bus.take_noticed() == set()
    assert took_ns < 1000 * MS, "its acknowledgements are recognized"


@pytest.mark.parametrize("ending", [b"\r", b"\r\n"])
def test_echo_is_no_frame_of_the_bus(
    line: EmulatedLine, behind: QueueingAdapter, monkeypatch: pytest.MonkeyPatch, ending: bytes
) -> None:
    """What an adapter echoes is dropped; the same frame from the bus is not."""
    receive = behind.receive

    def echoing(data: bytes) -> list[bytes]:
        answers = [data, *receive(data)]
        return [answer.replace(b"\r", ending) for answer in answers]

    monkeypatch.setattr(behind, "receive", echoing)
    bus = SlcanBus(line, 500_000)
    bus.open(())
    for frame in (A, B, A):
        bus.send(frame)
    line.comes(behind.adapter.give(A))

    assert behind.on_bus == [A, B, A]
    assert [bus.receive(MS), bus.receive(MS)] == [A, None]
    assert bus.take_noticed() == set()


@pytest.mark.parametrize("boots_ms", [300, 700, 1200, 1700, 2200])
def test_adapter_that_boots_when_its_port_is_opened_is_configured(
    line: EmulatedLine, behind: QueueingAdapter, monkeypatch: pytest.MonkeyPatch, boots_ms: int
) -> None:
    """Commands that it has not heard are repeated; its banner acknowledges nothing."""
    receive, ready_ns = behind.receive, line.now_ns() + boots_ms * MS

    def booting(data: bytes) -> list[bytes]:
        return receive(data) if line.now_ns() >= ready_ns else []

    monkeypatch.setattr(behind, "receive", booting)
    line.comes(b"\r\nslcan 1.3 ready\r\n", boots_ms * MS)
    bus = SlcanBus(line, 500_000)
    bus.open(())
    bus.send(A)

    assert b"".join(behind.commands).endswith(b"S6\rO\r" + encode(A))
    assert behind.on_bus == [A]
