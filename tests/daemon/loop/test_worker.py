"""A device behind a worker: the loop never waits, and no old sample is taken for a new one."""

import threading
from collections.abc import Iterator, Sequence
from math import inf, isnan
from typing import Any

import pytest

from piezod.daemon.loop.worker import STUCK_NS, DeviceWorker
from piezod.devices.interface import Capabilities, Sample
from piezod.devices.reconnecting import ReconnectingDevice
from piezod.devices.status import NO_FLAGS, DeviceFlag
from piezod.errors import DeviceError
from piezod.testing.fake_clock import FakeClock
from tests.daemon.waiting import eventually
from tests.devices.fake_link import WHO, FakeLink

MS = 1_000_000
STUCK = frozenset({DeviceFlag.STUCK})


class SlowLink(FakeLink):
    """A device whose exchanges last as long as a test wants."""

    def __init__(self) -> None:
        super().__init__()
        self.free = threading.Event()
        self.free.set()
        self.held = 0
        self.sent: list[float] = []
        self.breaks: Exception | None = None
        self.refuses = self.refuses_activation = False

    def activate(self, now_ns: int) -> None:
        if self.refuses_activation:
            raise DeviceError("it is driven by somebody else")
        super().activate(now_ns)

    def read(self, now_ns: int) -> Sequence[Sample]:
        self._wait()
        if self.breaks:
            raise self.breaks
        return super().read(now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        self._wait()
        if self.refuses:
            return False
        self.sent += drive_v
        return super().write(drive_v, now_ns)

    def _wait(self) -> None:
        if self.free.is_set():
            return
        self.held += 1
        self.free.wait()
        self.held -= 1


class Bench:
    """A worker, its device, and the cycles of a loop of 1 ms."""

    def __init__(self, **options: Any) -> None:
        self.link = SlowLink()
        self.link.open()
        self.link.activate(0)
        self.clock = FakeClock(MS)
        self.worker = DeviceWorker(self.link, self.clock, MS, MS, pause_s=0.0, **options)
        self.worker.thread.start()
        self.now_ns = MS

    def begin(self) -> Sequence[Sample]:
        """Begin the next cycle: read."""
        self.now_ns += MS
        self.clock.t_ns = max(self.clock.t_ns, self.now_ns)
        return self.worker.read(self.now_ns)

    def write(self, drive_v: float) -> bool:
        """End a cycle: write."""
        return self.worker.write([drive_v], self.now_ns)

    def sampled(self) -> Sample:
        """Begin cycles until one has a sample."""
        return eventually(lambda: [one for one in self.begin() if one.valid])[0]

    def close(self) -> None:
        """End the thread."""
        self.link.free.set()
        self.worker.close()
        assert not self.worker.thread.is_alive()


@pytest.fixture
def bench() -> Iterator[Bench]:
    """Return a device behind a worker."""
    bench = Bench()
    yield bench
    bench.close()


def test_samples_come_with_the_instants_at_which_they_were_taken(bench: Bench) -> None:
    """The instant of a sample is on the clock of the loop, not after the cycle that gets it."""
    first = bench.begin()
    found = bench.sampled()

    assert [one.valid for one in first] == [False]
    assert MS <= found.t_ns <= bench.now_ns
    assert found.position_um == 1.0


def test_read_back_is_known_in_the_first_cycle(bench: Bench) -> None:
    """The device is read back before the thread begins."""
    bench.link.free.clear()
    bench.begin()

    assert bench.worker.read_back(bench.now_ns) == [0.0]


def test_a_sample_is_given_once(bench: Bench) -> None:
    """A cycle without a new sample gets an invalid one; no sample is repeated."""
    bench.sampled()
    bench.link.free.clear()
    bench.begin()
    eventually(lambda: bench.link.held)
    bench.begin()  # with the sample of the round before
    given = bench.begin()

    assert [one.valid for one in given] == [False]


def test_the_newest_setpoint_wins(bench: Bench) -> None:
    """Setpoints that were replaced while the device was busy are never sent."""
    bench.sampled()
    bench.link.free.clear()
    bench.begin()
    bench.write(1.0)
    eventually(lambda: bench.link.held)
    for drive_v in (2.0, 3.0, 4.0):
        assert bench.write(drive_v)
    bench.link.free.set()
    eventually(lambda: 4.0 in bench.link.sent)

    assert bench.link.sent in ([1.0, 4.0], [4.0])
    eventually(lambda: bench.begin() and bench.worker.read_back(bench.now_ns) == [4.0])


def test_a_write_returns_what_became_of_the_one_before(bench: Bench) -> None:
    """Writes fail while the device refuses, and succeed again when it accepts."""
    bench.begin()
    assert bench.write(1.0)
    bench.link.refuses = True
    eventually(lambda: bench.begin() and not bench.write(2.0))
    bench.link.refuses = False
    eventually(lambda: bench.begin() and bench.write(3.0))


def test_a_device_that_refuses_activation_accepts_no_write(bench: Bench) -> None:
    """Nothing is sent to a device that refused activation, and every write fails."""
    bench.worker.deactivate(bench.now_ns)
    bench.link.refuses_activation = True
    bench.worker.activate(bench.now_ns)
    eventually(lambda: bench.begin() and not bench.write(1.0) and not bench.worker.crash)
    eventually(lambda: bench.begin() and not bench.write(2.0))
    bench.link.refuses_activation = False
    bench.worker.activate(bench.now_ns)
    eventually(lambda: bench.begin() and bench.write(3.0))

    assert not {1.0, 2.0} & set(bench.link.sent)


@pytest.mark.fault("B15")
def test_a_device_that_does_not_answer_is_stuck_until_it_does(bench: Bench) -> None:
    """After two periods writes fail and values are unknown; later the flag is STUCK."""
    bench.sampled()
    bench.link.free.clear()
    bench.begin()
    bench.write(5.0)
    eventually(lambda: bench.link.held)
    began_ns = bench.now_ns
    while bench.now_ns <= began_ns + 4 * MS:
        samples = bench.begin()
    late = bench.worker.status(bench.now_ns)
    while bench.now_ns <= began_ns + STUCK_NS + MS:
        samples = bench.begin()

    assert late == [frozenset({DeviceFlag.SLOW_REPLY})] * 2
    assert bench.worker.status(bench.now_ns) == [STUCK, STUCK]
    assert not samples[0].valid
    assert not bench.write(6.0)
    assert all(map(isnan, bench.worker.read_back(bench.now_ns)))

    bench.link.free.set()
    eventually(lambda: bench.begin() and bench.worker.status(bench.now_ns) == [NO_FLAGS] * 2)
    assert bench.sampled().valid


def test_a_setpoint_that_has_waited_too_long_is_not_sent(bench: Bench) -> None:
    """A setpoint from before a device hung is dropped when the device answers again."""
    bench.sampled()
    bench.link.free.clear()
    bench.begin()
    eventually(lambda: bench.link.held)
    bench.write(7.0)
    for _ in range(5):
        bench.begin()
    bench.link.free.set()
    bench.sampled()

    assert 7.0 not in bench.link.sent
    eventually(lambda: bench.begin() and bench.write(8.0))
    eventually(lambda: 8.0 in bench.link.sent)


@pytest.mark.fault("B15")
def test_a_driver_that_fails_is_tried_again_after_a_pause(bench: Bench) -> None:
    """The flag STUCK stays while the driver fails; the thread does not end."""
    bench.link.breaks = RuntimeError("no such luck")
    eventually(lambda: bench.begin() and bench.worker.status(bench.now_ns) == [STUCK, STUCK])
    assert str(bench.worker.crash) == "no such luck"

    bench.link.breaks = None
    assert bench.sampled().valid
    assert bench.worker.crash is None


def test_passing_flags_are_reported_once_and_lasting_ones_always(bench: Bench) -> None:
    """A cycle without a new round repeats no passing flag."""
    bench.link.noticed(DeviceFlag.BAD_CHECKSUM)
    bench.link.noticed(DeviceFlag.OVERLOAD)
    eventually(lambda: bench.begin() and any(bench.worker.status(bench.now_ns)))
    reported = bench.worker.status(bench.now_ns)
    again = bench.worker.status(bench.now_ns)
    bench.link.free.clear()
    eventually(lambda: bench.begin() and bench.link.held)

    assert reported == again == [frozenset({DeviceFlag.BAD_CHECKSUM, DeviceFlag.OVERLOAD})] * 2
    assert all(DeviceFlag.BAD_CHECKSUM not in flags for flags in bench.worker.status(bench.now_ns))


def test_flags_of_a_round_between_two_cycles_are_kept() -> None:
    """If two rounds end between two cycles, the passing flags of the first are reported too."""
    bench = Bench()
    bench.link.noticed(DeviceFlag.GARBAGE)
    bench.begin()
    eventually(lambda: bench.link.reads == 1)
    bench.write(1.0)
    eventually(lambda: bench.link.reads == 2)
    bench.write(2.0)
    eventually(lambda: bench.link.reads == 3)
    bench.begin()

    assert DeviceFlag.GARBAGE in bench.worker.status(bench.now_ns)[0]
    bench.close()


def test_a_device_that_is_deactivated_is_neither_read_nor_written() -> None:
    """An inactive device is still read back; after activation, no older setpoint is sent."""
    bench = Bench()
    bench.worker.deactivate(0)
    eventually(lambda: "deactivate" in bench.link.done[-1])
    bench.write(3.0)
    reads = bench.link.reads
    eventually(lambda: bench.begin() and bench.worker.read_back(bench.now_ns) == [0.0])
    assert bench.link.reads == reads

    bench.worker.activate(0)
    bench.sampled()
    assert bench.link.sent == []
    bench.close()


def test_a_device_with_an_exchange_is_written_and_read_in_one() -> None:
    """The sample of the round is that of the exchange."""
    bench = Bench(exchanges=True)
    bench.begin()
    eventually(lambda: bench.link.reads)
    bench.write(2.0)
    eventually(lambda: 2.0 in bench.link.sent)

    assert bench.sampled().valid
    bench.close()


def test_a_device_that_is_lost_is_opened_again_behind_the_worker() -> None:
    """The worker runs on and reports the flags of the reconnecting device."""
    link = SlowLink()
    link.open()
    reconnecting = ReconnectingDevice(link, WHO, first_wait_s=0.0005, longest_wait_s=0.001)
    worker = DeviceWorker(reconnecting, FakeClock(MS), MS, MS)
    for thread in (reconnecting.thread, worker.thread):
        thread.start()
    link.pulled = True
    cycles = iter(range(2 * MS, 10_000 * MS, MS))

    def gone() -> bool:
        now_ns = next(cycles)
        worker.read(now_ns)
        return DeviceFlag.HALF_OPEN in worker.status(now_ns)[0]

    eventually(gone)
    link.pulled = False
    eventually(lambda: not gone() and reconnecting.there)
    worker.close()

    assert not reconnecting.thread.is_alive()


def test_rounds_keep_to_the_pace_of_the_device() -> None:
    """A request for a round does not shorten the pause between rounds; closing does."""
    bench = Bench(pace_ns=3600 * 1000 * MS)
    bench.begin()
    eventually(lambda: bench.link.reads == 1)
    for _ in range(5):
        bench.begin()
        bench.write(1.0)

    assert bench.link.reads == 1
    assert bench.link.sent == []
    bench.close()


def test_an_amplifier_follows_any_loop() -> None:
    """A worker reports no highest rate for an amplifier, and keeps that of a sensor."""

    class Alone(FakeLink):
        def capabilities(self) -> Capabilities:
            return super().capabilities()._replace(inputs=())

    for link, rate_hz in ((FakeLink(), 1000.0), (Alone(), inf)):
        link.open()
        worker = DeviceWorker(link, FakeClock(), MS, MS)
        assert worker.capabilities().max_rate_hz == rate_hz
        assert worker.capabilities().lag_ns == 3 * MS
        worker.close()


def test_rounds_that_began_before_a_loan_has_ended_count_no_more(bench: Bench) -> None:
    """Neither the last round, nor one that is under way then; only one that begins afterwards."""
    bench.sampled()
    eventually(lambda: bench.worker.idle)
    bench.link.free.clear()
    bench.begin()
    eventually(lambda: bench.link.held)
    bench.worker.forget()
    last_v = bench.worker.read_back(bench.now_ns)
    bench.link.free.set()
    eventually(lambda: bench.worker.idle)
    (sample,) = bench.begin()
    under_way_v = bench.worker.read_back(bench.now_ns)

    assert isnan(last_v[0])
    assert isnan(under_way_v[0])
    assert not sample.valid
    assert bench.sampled().valid
    assert list(bench.worker.read_back(bench.now_ns)) == [0.0]
