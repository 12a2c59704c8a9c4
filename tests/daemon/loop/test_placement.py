"""Where each device is used, from how long its round trips take."""

from collections.abc import Sequence
from math import inf

import pytest

from piezod.daemon.loop.placement import (
    DevicePlace,
    Placement,
    RoundTrips,
    cost_ns,
    measure,
    place,
    raise_threads,
    refusal,
    start_threads,
)
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.interface import Capabilities, Sample
from piezod.devices.reconnecting import ReconnectingDevice
from piezod.devices.wrapper import CombinedExchange
from piezod.testing.fake_clock import FakeClock
from tests.devices.fake_link import WHO, FakeLink

US = 1_000


class TimedLink(FakeLink):
    """A device whose exchanges take a time that is known.

    Args:
        clock: What they take it of.
        read_us: How long a reading takes.
        read_back_us: How long a read-back takes.
        able: What differs in what it can do.
    """

    def __init__(
        self, clock: FakeClock, read_us: float, read_back_us: float = 0.0, **able: object
    ) -> None:
        super().__init__()
        self._clock, self._able = clock, able
        self._read_ns, self._read_back_ns = round(read_us * US), round(read_back_us * US)
        self.writes = 0

    def capabilities(self) -> Capabilities:
        return super().capabilities()._replace(**self._able)  # type: ignore[arg-type] # as given

    def read(self, now_ns: int) -> Sequence[Sample]:
        self._clock.spend_ns(self._read_ns)
        return super().read(now_ns)

    def read_back(self, now_ns: int) -> Sequence[float]:
        self._clock.spend_ns(self._read_back_ns)
        return super().read_back(now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        self.writes += 1
        return super().write(drive_v, now_ns)


class Plain:
    """A device that cannot be lost, and has no exchange for both roles."""

    def __init__(self, link: TimedLink) -> None:
        self.capabilities, self.read, self.read_back = link.capabilities, link.read, link.read_back
        self.open, self.close, self.write = link.open, link.close, link.write
        self.activate, self.deactivate = link.activate, link.deactivate


def placed(*devices: object, rate_hz: float = 1000.0, clock: FakeClock) -> list[Placement]:
    """Place devices d0, d1, ….."""
    names = {f"d{i}": device for i, device in enumerate(devices)}
    return place(names, dict.fromkeys(names, WHO), rate_hz, clock)  # type: ignore[arg-type] # fakes


@pytest.mark.parametrize(
    ("read_us", "read_back_us", "expected"),
    [
        (100.0, 100.0, DevicePlace.CYCLE),
        (160.0, 160.0, DevicePlace.CYCLE),
        (240.0, 240.0, DevicePlace.COMBINED),
        (300.0, 0.0, DevicePlace.COMBINED),
        (400.0, 300.0, DevicePlace.WORKER),
        (5000.0, 0.0, DevicePlace.WORKER),
    ],
)
def test_a_device_is_placed_by_what_its_exchanges_take(
    read_us: float, read_back_us: float, expected: DevicePlace
) -> None:
    """Half a period is there for reading, read-back and a write; else for one exchange, or none."""
    clock = FakeClock()
    link = TimedLink(clock, read_us, read_back_us)
    [one] = placed(link, clock=clock)

    assert one.place is expected
    assert link.writes == 0
    assert one.trips.median_ns == pytest.approx((read_us + read_back_us) * US, abs=1 * US)


def test_what_is_put_around_a_device_is_what_its_place_needs() -> None:
    """A device that can be lost is tended wherever it is."""
    clock = FakeClock()
    kinds = []
    for read_us in (1.0, 300.0, 900.0):
        [one] = placed(TimedLink(clock, read_us), clock=clock)
        kinds.append((type(one.device), len(one.threads)))

    assert kinds == [(ReconnectingDevice, 1), (CombinedExchange, 1), (DeviceWorker, 2)]


def test_a_device_that_is_fast_and_cannot_be_lost_is_used_as_it_is() -> None:
    """Nothing comes between."""
    clock = FakeClock()
    plain = Plain(TimedLink(clock, 1.0))
    [one] = placed(plain, clock=clock)

    assert one.device is plain
    assert one.threads == []


def test_the_fastest_come_first_into_the_cycle() -> None:
    """Until it is full; the order of the devices stays."""
    clock = FakeClock()
    sensors = [TimedLink(clock, read_us, outputs=()) for read_us in (300.0, 200.0, 100.0)]
    found = placed(*sensors, clock=clock)

    assert [one.name for one in found] == ["d0", "d1", "d2"]
    assert [one.place for one in found] == [
        DevicePlace.WORKER,
        DevicePlace.CYCLE,
        DevicePlace.CYCLE,
    ]


def test_a_sensor_slower_than_the_loop_is_refused_by_name() -> None:
    """The text says how long it takes and what it allows."""
    clock = FakeClock()
    fast, slow = TimedLink(clock, 1.0), TimedLink(clock, 5000.0, outputs=())
    found = placed(fast, slow, clock=clock)

    assert refusal(found, 1000.0) == (
        "rate_hz is 1000; device d1 measures at most 200 times a second, its round trip takes "
        "5 ms: choose a lower rate"
    )
    assert refusal(found, 199.0) == ""


def test_a_sensor_that_is_slow_now_and_then_is_not_refused() -> None:
    """It is used behind a worker, so that nobody waits; its usual round trip is what counts."""

    class Unsteady(TimedLink):
        def read(self, now_ns: int) -> Sequence[Sample]:
            if self.reads % 5 == 0:
                self._clock.spend_ns(5000 * US)
            return super().read(now_ns)

    clock = FakeClock()
    found = placed(Unsteady(clock, 70.0, outputs=()), clock=clock)

    assert found[0].place is DevicePlace.WORKER
    assert refusal(found, 1000.0) == ""


def test_a_sensor_may_say_itself_that_it_is_slower() -> None:
    """However fast it answers: it would tell old samples."""
    clock = FakeClock()
    found = placed(TimedLink(clock, 1.0, max_rate_hz=100.0), clock=clock)

    assert "measures at most 100 times a second" in refusal(found, 1000.0)


def test_a_slow_amplifier_is_not_waited_for() -> None:
    """Neither where it takes long, nor where it says so; it is refused at no rate."""
    clock = FakeClock()
    says_so = TimedLink(clock, 0.0, 1.0, inputs=(), max_rate_hz=50.0)
    takes_long = TimedLink(clock, 0.0, 20_000.0, inputs=())
    found = placed(says_so, takes_long, clock=clock)

    assert [one.place for one in found] == [DevicePlace.WORKER, DevicePlace.WORKER]
    assert [one.allowed_hz for one in found] == [inf, inf]
    assert refusal(found, 20_000.0) == ""


def silent_amplifier(clock: FakeClock, max_rate_hz: float) -> TimedLink:
    """Return an amplifier that can be asked for nothing."""
    return TimedLink(clock, 0.0, inputs=(), read_back=False, max_rate_hz=max_rate_hz)


@pytest.mark.parametrize(
    ("max_rate_hz", "rate_hz", "expected"),
    [
        (1050.0, 500.0, DevicePlace.CYCLE),  # as a DAC on CAN
        (1050.0, 600.0, DevicePlace.WORKER),
        (100.0, 60.0, DevicePlace.WORKER),
        (100.0, 200.0, DevicePlace.WORKER),
        (1e5, 1000.0, DevicePlace.CYCLE),
    ],
)
def test_an_amplifier_that_tells_nothing_costs_what_it_says(
    max_rate_hz: float, rate_hz: float, expected: DevicePlace
) -> None:
    """Its write, which nobody has tried, may wait for a reply."""
    clock = FakeClock()
    [one] = placed(silent_amplifier(clock, max_rate_hz), clock=clock, rate_hz=rate_hz)
    write_ns = 1e9 / max_rate_hz
    lag_ns = one.device.capabilities().lag_ns

    assert one.place is expected
    assert cost_ns(one.able, one.trips) == pytest.approx(write_ns, abs=1 * US)
    if expected is DevicePlace.WORKER:
        assert lag_ns == pytest.approx(3 * write_ns, abs=3 * US)


def test_an_amplifier_that_tells_nothing_does_not_drive_out_a_sensor() -> None:
    """It is not taken for the fastest of all."""
    clock = FakeClock()
    amplifier, sensor = silent_amplifier(clock, 1050.0), TimedLink(clock, 100.0, outputs=())
    found = placed(amplifier, sensor, clock=clock, rate_hz=500.0)

    assert [one.place for one in found] == [DevicePlace.WORKER, DevicePlace.CYCLE]


def test_a_device_costs_its_exchanges_and_a_write() -> None:
    """One as long as the longest of them, where it has outputs."""
    trips = RoundTrips(10, 30, 90, 20, 5)
    able = Capabilities(("x",), ("x",), read_back=True, max_rate_hz=10.0)

    assert cost_ns(able, trips) == 50
    assert cost_ns(able._replace(inputs=()), trips) == 50
    assert cost_ns(able._replace(read_back=False), trips) == 50
    assert cost_ns(able._replace(outputs=()), trips) == 30


def test_a_single_round_trip_that_was_held_up_counts_for_nothing() -> None:
    """One in a hundred is left out."""

    class HeldUp(TimedLink):
        def read(self, now_ns: int) -> Sequence[Sample]:
            if self.reads == 50:
                self._clock.spend_ns(10_000 * US)
            return super().read(now_ns)

    clock = FakeClock()
    link = HeldUp(clock, 10.0)
    trips = measure(link, link.capabilities(), clock)

    assert trips.p99_ns < 20 * US


def test_a_driver_that_fails_when_it_is_measured_harms_nobody() -> None:
    """The loop will meet it again, and tell it."""

    class Failing(TimedLink):
        def read(self, now_ns: int) -> Sequence[Sample]:
            self._clock.spend_ns(900 * US)
            raise RuntimeError(f"no luck at {now_ns}")

    clock = FakeClock()
    [one] = placed(Failing(clock, 0.0), clock=clock)

    assert one.place is DevicePlace.WORKER


def test_a_placement_is_shown_as_plain_values() -> None:
    """Name, who it is, where, round trips in µs, what it can do."""
    clock = FakeClock()
    [one] = placed(TimedLink(clock, 100.0), clock=clock)
    document = one.document()

    assert (document["name"], document["placement"]) == ("d0", "in the cycle")
    assert document["identity"]["model"] == "stage"
    assert document["round_trip_us"] == {
        "p50": pytest.approx(100.0, abs=1.0),
        "p99": pytest.approx(100.0, abs=1.0),
    }
    assert document["capabilities"]["read_back"] is True


def test_threads_are_started_once_all_is_decided(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are counted; the interpreter is told to change between them more often."""
    intervals: list[float] = []
    monkeypatch.setattr("sys.setswitchinterval", intervals.append)
    clock = FakeClock()
    found = placed(TimedLink(clock, 900.0), TimedLink(clock, 1.0), clock=clock)

    assert start_threads(found) == 3
    raise_threads(found)  # without a priority of the loop there is nothing to raise
    for one in found:
        one.device.close()
    assert start_threads([]) == 0
    assert intervals == [1e-4]


def test_workers_run_one_below_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """And nobody else does."""
    raised: list[tuple[int, int]] = []
    monkeypatch.setattr("os.sched_getparam", lambda _pid: type("P", (), {"sched_priority": 60}))
    monkeypatch.setattr(
        "os.sched_setscheduler",
        lambda tid, _policy, parameters: raised.append((tid, parameters.sched_priority)),
    )
    clock = FakeClock()
    found = placed(TimedLink(clock, 900.0), TimedLink(clock, 1.0), clock=clock)
    monkeypatch.setattr("sys.setswitchinterval", lambda _interval: None)
    start_threads(found)
    raise_threads(found)
    worker = found[0].threads[-1].native_id
    for one in found:
        one.device.close()

    assert raised == [(worker, 59)]
