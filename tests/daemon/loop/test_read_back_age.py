"""The age of a read-back behind a worker: what the guard may reckon with, and no more."""

import threading
from collections.abc import Iterator, Sequence
from itertools import pairwise

import pytest

from piezod.control.guard import Guard, Limits
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.channels import Channels
from piezod.devices.interface import Capabilities, Sample
from piezod.devices.wiring import ChannelPair
from piezod.devices.wrapper import DeviceWrapper
from piezod.testing.fake_clock import FakeClock
from tests.daemon.waiting import eventually
from tests.devices.fake_link import FakeLink

MS = 1_000_000
LIMITS = Limits(drive_min_v=0.0, drive_max_v=150.0, slew_v_per_s=2000.0)
STEP_V, TOLERANCE_V = 2.0, 0.75
BUSY_NS = 100 * MS
"""A round as a busy machine has measured it at the start."""


class GatedLink(FakeLink):
    """A device whose rounds end one by one, and whose output may be stuck."""

    def __init__(self) -> None:
        super().__init__()
        self.gate, self.begun = threading.Semaphore(0), 0
        self.writes: list[float] = []
        self.sticks = False

    def read(self, now_ns: int) -> Sequence[Sample]:
        self.begun += 1
        self.gate.acquire()
        return super().read(now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        self.writes += drive_v
        return self.sticks or super().write(drive_v, now_ns)


class Loop:
    """A loop of 1 ms with a guard, which drives such a device behind a worker at the slew rate."""

    def __init__(self) -> None:
        self.link, self.clock = GatedLink(), FakeClock(MS)
        self.link.open()
        self.link.activate(0)
        self.worker = DeviceWorker(self.link, self.clock, MS, BUSY_NS)
        self.channels = Channels({"amp": self.link}, {"x": ChannelPair("amp", "amp")})
        self.channels.open()
        self.channels.use({"amp": self.worker})
        self.guard = Guard([LIMITS], 1e-3)
        self.worker.thread.start()
        self.now_ns, self.drive_v, self.rounds = MS, 0.0, 0
        self.waited: list[bool] = []

    def cycle(self) -> float:
        """Run a cycle; return how far the write is from the read-back, in V."""
        self.now_ns += MS
        self.clock.t_ns = self.now_ns
        self.channels.read(self.now_ns)
        eventually(lambda: self.link.begun > self.rounds)
        (shown_v,), (age_ns,) = (
            self.channels.read_back(self.now_ns),
            self.channels.read_back_age_ns(self.now_ns),
        )
        admitted = self.guard.admit(
            0,
            0,
            [LIMITS.drive_max_v],
            [self.drive_v],
            1e-3,
            read_back_v=[shown_v],
            age_s=[age_ns / 1e9],
        )
        self.waited.append(bool(admitted.waits))
        if admitted.writable:
            (self.drive_v,) = admitted.drive_v
            self.channels.write(admitted.drive_v, self.now_ns)
        return abs(self.drive_v - shown_v)

    def end_round(self) -> None:
        """Let the present round end, and the next one begin."""
        self.rounds += 1
        self.link.gate.release()
        eventually(lambda: self.link.begun > self.rounds)

    def run(self, rounds: int, cycles: int) -> float:
        """Run rounds that last some cycles; return the largest distance of a write, in V."""
        largest_v = 0.0
        for _ in range(rounds):
            for _ in range(cycles):
                largest_v = max(largest_v, self.cycle())
            self.end_round()
        return largest_v


@pytest.fixture
def loop() -> Iterator[Loop]:
    """Return such a loop."""
    loop = Loop()
    yield loop
    loop.link.gate.release(10_000)
    loop.worker.close()


@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_motion_at_the_slew_rate_does_not_wait_for_usual_rounds(loop: Loop, cycles: int) -> None:
    """However many cycles a round takes, as long as it always takes so many."""
    loop.run(8, cycles)
    loop.waited.clear()
    loop.run(12, cycles)

    assert not any(loop.waited)


def test_busy_start_does_not_widen_the_reach(loop: Loop) -> None:
    """Rounds are as short as they are now, whatever was measured at the start."""
    loop.run(20, 1)
    loop.link.sticks, stuck_v = True, loop.link.drive_v[0]
    loop.run(20, 1)

    assert max(abs(each_v - stuck_v) for each_v in loop.link.writes[-20:]) <= 4 * STEP_V
    assert loop.waited[-1]


def test_slow_round_is_waited_for(loop: Loop) -> None:
    """The writes do not go on as far as the slew rate allows meanwhile."""
    loop.run(20, 1)
    far_v = loop.run(1, 40)
    loop.run(1, 1)
    steps_v = [abs(b - a) for a, b in pairwise(loop.link.writes)]

    assert far_v <= 5 * STEP_V
    assert max(steps_v) <= 5 * STEP_V


def test_nothing_unanswered_has_no_age(loop: Loop) -> None:
    """While nothing is written, a read-back tells what is in force, however old it is."""
    loop.run(10, 3)
    ages_ns = list[int]()
    for _ in range(20):
        loop.now_ns += MS
        loop.channels.read(loop.now_ns)
        ages_ns += loop.channels.read_back_age_ns(loop.now_ns)
        loop.end_round()

    assert set(ages_ns[5:]) == {0}


def test_delay_that_a_driver_tells_is_an_age() -> None:
    """Of the device itself, and behind its wrappers."""

    class Delayed(FakeLink):
        def capabilities(self) -> Capabilities:
            return super().capabilities()._replace(lag_ns=7 * MS)

    link = Delayed()
    channels = Channels({"amp": link}, {"x": ChannelPair("amp", "amp")})
    channels.open()
    alone_ns = channels.read_back_age_ns(0)
    channels.use({"amp": DeviceWrapper(DeviceWrapper(link))})
    wrapped_ns = channels.read_back_age_ns(0)
    worker = DeviceWorker(link, FakeClock(MS), MS, MS)

    assert alone_ns == wrapped_ns == [7 * MS]
    assert worker.read_back_age_ns(2 * MS) == 7 * MS
    assert worker.capabilities().lag_ns == 10 * MS
