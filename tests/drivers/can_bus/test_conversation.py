"""One exchange of CAN frames: no stale frame is taken for a reply."""

import random

import pytest

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.conversation import LATE_TIMEOUTS, MAX_FRAMES, CanConversation
from piezod_drivers.can_bus.frame import Frame
from tests.drivers.can_bus.fake_bus import FakeBus
from tests.drivers.serial_line.scripted_line import MS

TIMEOUT_NS = 5 * MS
ASKS, ANSWERS, OTHER, OURS = 0x80, 0x285, 0x705, 0x305
ASK = [Frame(ASKS)]
EXPECTED = frozenset({ANSWERS})


class _Bench:
    def __init__(self) -> None:
        self.bus = FakeBus()
        self.taken: list[Frame] = []
        self.cycle = CanConversation(self.bus, TIMEOUT_NS, (ASKS, OURS), self.taken.append)

    def ask(self) -> bytes:
        return self.cycle.ask(ASK, EXPECTED)[ANSWERS]

    def fails(self) -> DeviceFlag:
        with pytest.raises(LineFault) as failure:
            self.ask()
        return failure.value.flag


@pytest.fixture
def bench() -> _Bench:
    """Return a conversation on a bus without a node."""
    return _Bench()


def test_answer_is_what_comes_after_the_request(bench: _Bench) -> None:
    """A frame that came before the request is no reply to it and is reported."""
    bench.bus.comes(Frame(ANSWERS, b"old"))
    bench.bus.comes(Frame(ANSWERS, b"new"), after_ns=MS)

    assert bench.ask() == b"new"
    assert bench.cycle.take_noticed() == {DeviceFlag.OUT_OF_ORDER}
    assert bench.cycle.take_noticed() == set()


def test_other_frames_are_passed_on(bench: _Bench) -> None:
    """Other frames are passed on, before the request and during the wait."""
    bench.bus.comes(Frame(OTHER, b"1"))
    bench.bus.comes(Frame(OTHER, b"2"), Frame(ANSWERS), after_ns=MS)
    bench.ask()

    assert [frame.data for frame in bench.taken] == [b"1", b"2"]


@pytest.mark.sees("canopen", "B12")
@pytest.mark.sees("can_dbc", "B12")
def test_foreign_frame_is_reported(bench: _Bench) -> None:
    """A received frame with an own identifier is reported as foreign."""
    bench.bus.comes(Frame(OURS), Frame(ANSWERS), after_ns=MS)
    bench.ask()

    assert bench.cycle.take_noticed() == {DeviceFlag.FOREIGN_FRAME}
    assert bench.taken == []


def test_second_answer_is_dropped(bench: _Bench) -> None:
    """A second reply is reported and is no reply to the next request."""
    bench.bus.comes(Frame(ANSWERS, b"1"), Frame(ANSWERS, b"1"), after_ns=MS)
    bench.ask()
    bench.bus.comes(Frame(ANSWERS, b"2"), after_ns=MS)

    assert bench.ask() == b"2"
    assert bench.cycle.take_noticed() == {DeviceFlag.OUT_OF_ORDER}


def test_slow_answer_is_reported(bench: _Bench) -> None:
    """A reply that takes most of the time-out counts and is reported as slow."""
    bench.bus.comes(Frame(ANSWERS), after_ns=round(0.9 * TIMEOUT_NS))
    bench.ask()

    assert bench.cycle.take_noticed() == {DeviceFlag.SLOW_REPLY}


def test_nothing_is_asked_while_an_answer_is_owed(bench: _Bench) -> None:
    """After a time-out nothing is sent until the late reply has come and was dropped."""
    assert bench.fails() == DeviceFlag.LATE_REPLY
    bench.bus.comes(Frame(ANSWERS, b"late"), after_ns=3 * MS)
    assert bench.fails() == DeviceFlag.LATE_REPLY
    assert bench.bus.sent == ASK

    bench.bus.time.t_ns += 3 * MS
    bench.bus.comes(Frame(ANSWERS, b"new"), after_ns=MS)
    assert bench.ask() == b"new"
    assert DeviceFlag.LATE_REPLY in bench.cycle.take_noticed()


def test_frame_that_asks_pays_no_debt(bench: _Bench) -> None:
    """A remote frame with the reply's identifier does not end the wait for a late reply."""
    assert bench.fails() == DeviceFlag.LATE_REPLY
    bench.bus.comes(Frame(ANSWERS, remote=True))
    assert bench.fails() == DeviceFlag.LATE_REPLY
    assert bench.bus.sent == ASK


def test_owed_answer_is_given_up(bench: _Bench) -> None:
    """After `LATE_TIMEOUTS` time-outs an overdue reply counts as lost, and requests go on."""
    assert bench.fails() == DeviceFlag.LATE_REPLY
    bench.bus.time.t_ns += LATE_TIMEOUTS * TIMEOUT_NS
    bench.bus.comes(Frame(ANSWERS, b"new"), after_ns=MS)

    assert bench.ask() == b"new"


@pytest.mark.parametrize("transactions", [2000, pytest.param(100_000, marks=pytest.mark.stress)])
def test_no_late_answer_is_taken_for_another(transactions: int) -> None:
    """With replies up to ten time-outs late, each accepted reply belongs to its request."""
    bench = _Bench()
    drawn = random.Random(1)  # noqa: S311 - a trial that can be repeated
    wrong = right = 0
    for number in range(transactions):
        late = drawn.random() < 0.05
        after_ns = drawn.randrange(TIMEOUT_NS, 10 * TIMEOUT_NS) if late else MS
        sent_before = len(bench.bus.sent)

        def answer(_frame: Frame, n: int = number, after: int = after_ns) -> None:
            bench.bus.comes(Frame(ANSWERS, n.to_bytes(4, "big")), after_ns=after)

        bench.bus.on_send = answer
        try:
            got = int.from_bytes(bench.ask(), "big")
        except LineFault:
            bench.bus.time.t_ns += drawn.randrange(TIMEOUT_NS)
        else:
            right += got == number
            wrong += got != number
        assert len(bench.bus.sent) - sent_before <= 1

    assert wrong == 0
    assert right > transactions // 3


@pytest.mark.sees("canopen", "B11")
@pytest.mark.sees("can_dbc", "B11")
def test_babbling_bus_is_reported(bench: _Bench) -> None:
    """If reading does not end, nothing is sent and `MAX_FRAMES` frames are read."""
    bench.bus.comes(*[Frame(OTHER)] * 1000)

    assert bench.fails() == DeviceFlag.BUS_OVERLOADED
    assert bench.bus.sent == []
    assert len(bench.taken) == MAX_FRAMES


@pytest.mark.sees("canopen", "B11")
@pytest.mark.sees("can_dbc", "B11")
def test_babbling_while_waiting_is_reported(bench: _Bench) -> None:
    """Foreign frames instead of the reply end the wait."""
    bench.bus.comes(*[Frame(OTHER)] * 1000, after_ns=MS)

    assert bench.fails() == DeviceFlag.BUS_OVERLOADED


@pytest.mark.sees("canopen", "B9")
@pytest.mark.sees("can_dbc", "B9")
def test_frame_that_cannot_be_sent_is_reported(bench: _Bench) -> None:
    """A full transmit queue fails the exchange; with room again, the next one works."""
    bench.bus.fault = DeviceFlag.NOT_SENT
    assert bench.fails() == DeviceFlag.NOT_SENT

    bench.bus.fault = None
    bench.bus.time.t_ns += (LATE_TIMEOUTS + 1) * TIMEOUT_NS
    bench.bus.comes(Frame(ANSWERS), after_ns=MS)
    bench.ask()


@pytest.mark.sees("canopen", "B8")
@pytest.mark.sees("can_dbc", "B8")
def test_bus_that_takes_nothing_is_as_good_as_off(bench: _Bench) -> None:
    """The third unsent frame in a row is reported as bus off, and the bus as stalled."""
    bench.bus.fault = DeviceFlag.NOT_SENT
    flags = []
    for _ in range(3):
        flags.append(bench.fails())
        bench.bus.time.t_ns += (LATE_TIMEOUTS + 1) * TIMEOUT_NS

    assert flags == [DeviceFlag.NOT_SENT, DeviceFlag.NOT_SENT, DeviceFlag.BUS_OFF]
    assert bench.bus.told_of_stall == 1
