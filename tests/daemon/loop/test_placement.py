"""Placement of devices by the duration of their round trips."""

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
    raise_thread_priorities,
    rate_refusal,
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
    """A device whose exchanges have a known duration."""

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
    """A device that cannot be lost and has no combined exchange."""

    def __init__(self, link: TimedLink) -> None:
        self.capabilities, self.read, self.read_back = link.capabilities, link.read, link.read_back
        self.open, self.close, self.write = link.open, link.close, link.write
        self.activate, self.deactivate = link.activate, link.deactivate


def placed(*devices: object, rate_hz: float = 1000.0, clock: FakeClock) -> list[Placement]:
    """Place devices d0, d1, …."""
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
def test_a_device_is_placed_by_the_duration_of_its_exchanges(
    read_us: float, read_back_us: float, expected: DevicePlace
) -> None:
    """Half a period must have room for read, read-back and write, or else for one exchange."""
    clock = FakeClock()
    link = TimedLink(clock, read_us, read_back_us)
    [one] = placed(link, clock=clock)

    assert one.place is expected
    assert link.writes == 0
    assert one.trips.median_ns == pytest.approx((read_us + read_back_us) * US, abs=1 * US)


def test_a_device_gets_the_wrappers_that_its_place_needs() -> None:
    """A device that can be lost gets a reconnecting wrapper in every place."""
    clock = FakeClock()
    kinds = []
    for read_us in (1.0, 300.0, 900.0):
        [one] = placed(TimedLink(clock, read_us), clock=clock)
        kinds.append((type(one.device), len(one.threads)))

    assert kinds == [(ReconnectingDevice, 1), (CombinedExchange, 1), (DeviceWorker, 2)]


def test_a_device_that_is_fast_and_cannot_be_lost_gets_no_wrapper() -> None:
    """The device itself is used, without a thread."""
    clock = FakeClock()
    plain = Plain(TimedLink(clock, 1.0))
    [one] = placed(plain, clock=clock)

    assert one.device is plain
    assert one.threads == []


def test_the_fastest_come_first_into_the_cycle() -> None:
    """The fastest devices fill the cycle; the list keeps the order of the devices."""
    clock = FakeClock()
    sensors = [TimedLink(clock, read_us, outputs=()) for read_us in (300.0, 200.0, 100.0)]
    found = placed(*sensors, clock=clock)

    assert [one.name for one in found] == ["d0", "d1", "d2"]
    assert [one.place for one in found] == [
        DevicePlace.WORKER,
        DevicePlace.CYCLE,
        DevicePlace.CYCLE,
    ]


def test_a_sensor_slower_than_the_loop_is_refused() -> None:
    """The message names the device, its round trip and its highest rate."""
    clock = FakeClock()
    fast, slow = TimedLink(clock, 1.0), TimedLink(clock, 5000.0, outputs=())
    found = placed(fast, slow, clock=clock)

    assert rate_refusal(found, 1000.0) == (
        "rate_hz is 1000; device d1 measures at most 200 times a second (round trip 5 ms): "
        "choose a lower rate"
    )
    assert rate_refusal(found, 199.0) == ""


def test_a_sensor_that_is_rarely_slow_is_not_refused() -> None:
    """It is used behind a worker; the median of its round trips counts."""

    class Unsteady(TimedLink):
        def read(self, now_ns: int) -> Sequence[Sample]:
            if self.reads % 5 == 0:
                self._clock.spend_ns(5000 * US)
            return super().read(now_ns)

    clock = FakeClock()
    found = placed(Unsteady(clock, 70.0, outputs=()), clock=clock)

    assert found[0].place is DevicePlace.WORKER
    assert rate_refusal(found, 1000.0) == ""


def test_the_highest_rate_that_a_sensor_reports_counts() -> None:
    """A sensor that replies quickly may still have old samples."""
    clock = FakeClock()
    found = placed(TimedLink(clock, 1.0, max_rate_hz=100.0), clock=clock)

    assert "measures at most 100 times a second" in rate_refusal(found, 1000.0)


def test_a_slow_amplifier_is_not_waited_for() -> None:
    """A slow amplifier is used behind a worker at any rate, if it reports its rate and if not."""
    clock = FakeClock()
    says_so = TimedLink(clock, 0.0, 1.0, inputs=(), max_rate_hz=50.0)
    takes_long = TimedLink(clock, 0.0, 20_000.0, inputs=())
    found = placed(says_so, takes_long, clock=clock)

    assert [one.place for one in found] == [DevicePlace.WORKER, DevicePlace.WORKER]
    assert [one.allowed_hz for one in found] == [inf, inf]
    assert rate_refusal(found, 20_000.0) == ""


def silent_amplifier(clock: FakeClock, max_rate_hz: float) -> TimedLink:
    """Return an amplifier without a read-back."""
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
def test_an_amplifier_without_read_back_costs_a_period_of_its_highest_rate(
    max_rate_hz: float, rate_hz: float, expected: DevicePlace
) -> None:
    """Its write may wait for a reply, and is never measured."""
    clock = FakeClock()
    [one] = placed(silent_amplifier(clock, max_rate_hz), clock=clock, rate_hz=rate_hz)
    write_ns = 1e9 / max_rate_hz
    lag_ns = one.device.capabilities().lag_ns

    assert one.place is expected
    assert cost_ns(one.able, one.trips) == pytest.approx(write_ns, abs=1 * US)
    if expected is DevicePlace.WORKER:
        assert lag_ns == pytest.approx(3 * write_ns, abs=3 * US)


def test_an_amplifier_without_read_back_leaves_room_for_a_sensor() -> None:
    """It does not count as the fastest device."""
    clock = FakeClock()
    amplifier, sensor = silent_amplifier(clock, 1050.0), TimedLink(clock, 100.0, outputs=())
    found = placed(amplifier, sensor, clock=clock, rate_hz=500.0)

    assert [one.place for one in found] == [DevicePlace.WORKER, DevicePlace.CYCLE]


def test_a_device_costs_its_exchanges_and_a_write() -> None:
    """A device with outputs costs its round trip and a write as long as its longest exchange."""
    trips = RoundTrips(10, 30, 90, 20, 5)
    able = Capabilities(("x",), ("x",), read_back=True, max_rate_hz=10.0)

    assert cost_ns(able, trips) == 50
    assert cost_ns(able._replace(inputs=()), trips) == 50
    assert cost_ns(able._replace(read_back=False), trips) == 50
    assert cost_ns(able._replace(outputs=()), trips) == 30


def test_a_single_delayed_round_trip_is_left_out() -> None:
    """The 99th percentile ignores one of a hundred."""

    class HeldUp(TimedLink):
        def read(self, now_ns: int) -> Sequence[Sample]:
            if self.reads == 50:
                self._clock.spend_ns(10_000 * US)
            return super().read(now_ns)

    clock = FakeClock()
    link = HeldUp(clock, 10.0)
    trips = measure(link, link.capabilities(), clock)

    assert trips.p99_ns < 20 * US


def test_a_driver_that_fails_when_it_is_measured_is_placed() -> None:
    """The failure is left to the loop, which reports it."""

    class Failing(TimedLink):
        def read(self, now_ns: int) -> Sequence[Sample]:
            self._clock.spend_ns(900 * US)
            raise RuntimeError(f"no luck at {now_ns}")

    clock = FakeClock()
    [one] = placed(Failing(clock, 0.0), clock=clock)

    assert one.place is DevicePlace.WORKER


def test_a_placement_is_shown_as_plain_values() -> None:
    """The document has name, identity, place, round trips in µs and capabilities."""
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


def test_threads_are_started_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The interpreter switches between threads more often if there are any."""
    intervals: list[float] = []
    monkeypatch.setattr("sys.setswitchinterval", intervals.append)
    clock = FakeClock()
    found = placed(TimedLink(clock, 900.0), TimedLink(clock, 1.0), clock=clock)

    assert start_threads(found) == 3
    raise_thread_priorities(found)  # without a priority of the loop there is nothing to raise
    for one in found:
        one.device.close()
    assert start_threads([]) == 0
    assert intervals == [1e-4]


def test_workers_run_one_below_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the workers get a real-time priority."""
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
    raise_thread_priorities(found)
    worker = found[0].threads[-1].native_id
    for one in found:
        one.device.close()

    assert raised == [(worker, 59)]
