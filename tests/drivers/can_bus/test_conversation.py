"""One exchange of frames: nothing stale is taken for an answer."""

import random

import pytest

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.conversation import MOST_FRAMES, PATIENCE, CanCycle
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
        self.cycle = CanCycle(self.bus, TIMEOUT_NS, (ASKS, OURS), self.taken.append)

    def ask(self) -> bytes:
        return self.cycle.ask(ASK, EXPECTED)[ANSWERS]

    def fails(self) -> DeviceFlag:
        with pytest.raises(LineFault) as failure:
            self.ask()
        return failure.value.flag


@pytest.fixture
def bench() -> _Bench:
    """Give a cycle on a bus where nobody is."""
    return _Bench()


def test_answer_is_what_comes_after_the_request(bench: _Bench) -> None:
    """A frame that came before the request is no answer to it, and is told of."""
    bench.bus.comes(Frame(ANSWERS, b"old"))
    bench.bus.comes(Frame(ANSWERS, b"new"), after_ns=MS)

    assert bench.ask() == b"new"
    assert bench.cycle.take_noticed() == {DeviceFlag.OUT_OF_ORDER}
    assert bench.cycle.take_noticed() == set()


def test_other_frames_are_passed_on(bench: _Bench) -> None:
    """Frames that are no answer go to whom they concern, before and while it is waited."""
    bench.bus.comes(Frame(OTHER, b"1"))
    bench.bus.comes(Frame(OTHER, b"2"), Frame(ANSWERS), after_ns=MS)
    bench.ask()

    assert [frame.data for frame in bench.taken] == [b"1", b"2"]


@pytest.mark.sees("canopen", "B12")
@pytest.mark.sees("can_dbc", "B12")
def test_foreign_frame_is_told(bench: _Bench) -> None:
    """A frame under an identifier of our own that comes from somebody else is told of."""
    bench.bus.comes(Frame(OURS), Frame(ANSWERS), after_ns=MS)
    bench.ask()

    assert bench.cycle.take_noticed() == {DeviceFlag.FOREIGN_FRAME}
    assert bench.taken == []


def test_second_answer_is_dropped(bench: _Bench) -> None:
    """An answer that comes twice is told of, and is none to the next request."""
    bench.bus.comes(Frame(ANSWERS, b"1"), Frame(ANSWERS, b"1"), after_ns=MS)
    bench.ask()
    bench.bus.comes(Frame(ANSWERS, b"2"), after_ns=MS)

    assert bench.ask() == b"2"
    assert bench.cycle.take_noticed() == {DeviceFlag.OUT_OF_ORDER}


def test_slow_answer_is_told(bench: _Bench) -> None:
    """An answer that takes most of its time counts, and is told of."""
    bench.bus.comes(Frame(ANSWERS), after_ns=round(0.9 * TIMEOUT_NS))
    bench.ask()

    assert bench.cycle.take_noticed() == {DeviceFlag.SLOW_REPLY}


def test_nothing_is_asked_while_an_answer_is_owed(bench: _Bench) -> None:
    """After a time-out no frame is sent until the late answer has come; it is dropped then."""
    assert bench.fails() == DeviceFlag.LATE_REPLY
    bench.bus.comes(Frame(ANSWERS, b"late"), after_ns=3 * MS)
    assert bench.fails() == DeviceFlag.LATE_REPLY
    assert bench.bus.sent == ASK

    bench.bus.time.t_ns += 3 * MS
    bench.bus.comes(Frame(ANSWERS, b"new"), after_ns=MS)
    assert bench.ask() == b"new"
    assert DeviceFlag.LATE_REPLY in bench.cycle.take_noticed()


def test_frame_that_asks_pays_no_debt(bench: _Bench) -> None:
    """A late answer is still owed when somebody else asks for a frame of its identifier."""
    assert bench.fails() == DeviceFlag.LATE_REPLY
    bench.bus.comes(Frame(ANSWERS, remote=True))
    assert bench.fails() == DeviceFlag.LATE_REPLY
    assert bench.bus.sent == ASK


def test_owed_answer_is_given_up(bench: _Bench) -> None:
    """When an answer has not come for long enough it is taken for lost, and asked for anew."""
    assert bench.fails() == DeviceFlag.LATE_REPLY
    bench.bus.time.t_ns += PATIENCE * TIMEOUT_NS
    bench.bus.comes(Frame(ANSWERS, b"new"), after_ns=MS)

    assert bench.ask() == b"new"


@pytest.mark.parametrize("transactions", [2000, pytest.param(100_000, marks=pytest.mark.stress)])
def test_no_late_answer_is_taken_for_another(transactions: int) -> None:
    """With answers late by up to ten time-outs, each one accepted belongs to its request."""
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
def test_babbling_bus_is_told(bench: _Bench) -> None:
    """Where reading does not end, nothing is sent, and no more than so many frames are read."""
    bench.bus.comes(*[Frame(OTHER)] * 1000)

    assert bench.fails() == DeviceFlag.BUS_OVERLOADED
    assert bench.bus.sent == []
    assert len(bench.taken) == MOST_FRAMES


@pytest.mark.sees("canopen", "B11")
@pytest.mark.sees("can_dbc", "B11")
def test_babbling_while_waiting_is_told(bench: _Bench) -> None:
    """Where others' frames come instead of the answer, waiting ends."""
    bench.bus.comes(*[Frame(OTHER)] * 1000, after_ns=MS)

    assert bench.fails() == DeviceFlag.BUS_OVERLOADED


@pytest.mark.sees("canopen", "B9")
@pytest.mark.sees("can_dbc", "B9")
def test_frame_that_cannot_be_sent_is_told(bench: _Bench) -> None:
    """A full transmit queue fails the exchange; when there is room the next one goes well."""
    bench.bus.fault = DeviceFlag.NOT_SENT
    assert bench.fails() == DeviceFlag.NOT_SENT

    bench.bus.fault = None
    bench.bus.time.t_ns += (PATIENCE + 1) * TIMEOUT_NS
    bench.bus.comes(Frame(ANSWERS), after_ns=MS)
    bench.ask()


@pytest.mark.sees("canopen", "B8")
@pytest.mark.sees("can_dbc", "B8")
def test_bus_that_takes_nothing_is_as_good_as_off(bench: _Bench) -> None:
    """The third frame in a row that cannot be sent: the bus is off, and told to be emptied."""
    bench.bus.fault = DeviceFlag.NOT_SENT
    flags = []
    for _ in range(3):
        flags.append(bench.fails())
        bench.bus.time.t_ns += (PATIENCE + 1) * TIMEOUT_NS

    assert flags == [DeviceFlag.NOT_SENT, DeviceFlag.NOT_SENT, DeviceFlag.BUS_OFF]
    assert bench.bus.told_of_stall == 1
