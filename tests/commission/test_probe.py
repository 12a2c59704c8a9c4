"""Inspection of devices without driving."""

from dataclasses import replace
from itertools import count

import pytest

from piezod.commission.probe import Probed, probe, together_hz
from piezod.devices import registry
from piezod.devices.interface import ChannelUnits, Sample
from piezod.devices.wiring import pairs_of
from piezod.testing.fake_clock import FakeClock
from piezod_drivers.simulated.driver import SimulatedRig
from tests.commission.axes import T0_NS, configured

US = 1_000
READ_US, READ_BACK_US = 150, 100


def probed(clock: FakeClock) -> Probed:
    """Probe the rig of the shipped configuration."""
    config = configured()
    return probe(config, pairs_of(config.axes), clock)["rig"]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    """Return the clock that determines the duration of the rig's exchanges."""
    clock, reads = FakeClock(T0_NS), count()
    read, read_back = SimulatedRig.read, SimulatedRig.read_back

    def slow_read(rig: SimulatedRig, now_ns: int) -> list[Sample]:
        clock.spend_ns((5000 if next(reads) % 20 == 0 else READ_US) * US)
        return list(read(rig, now_ns))

    def slow_read_back(rig: SimulatedRig, now_ns: int) -> list[float]:
        clock.spend_ns(READ_BACK_US * US)
        return list(read_back(rig, now_ns))

    monkeypatch.setattr(SimulatedRig, "read", slow_read)
    monkeypatch.setattr(SimulatedRig, "read_back", slow_read_back)
    return clock


def test_the_rate_is_the_one_by_which_the_daemon_places(clock: FakeClock) -> None:
    """Read, read-back, and a write as long as the longer one take half of its period.

    Delays in one of twenty exchanges do not count: they are mostly due to the machine.
    """
    found = probed(clock)

    assert found.read is not None
    assert found.read.p90_us == pytest.approx(READ_US, abs=1.0)
    assert found.read.p99_us == pytest.approx(5000, abs=1.0)
    assert found.cost_ns == pytest.approx((2 * READ_US + READ_BACK_US) * US, abs=US)
    assert found.rate_hz == pytest.approx(0.5e9 / found.cost_ns)


def test_devices_share_the_cycle() -> None:
    """Devices of 0.1 ms, 0.1 ms and 0.3 ms need twice their sum; the slowest may need more."""
    quick, slow = Probed("a", cost_ns=100_000, rate_hz=5000.0), Probed("b", rate_hz=400.0)

    assert together_hz([quick, quick, Probed("c", cost_ns=300_000, rate_hz=1666.0)]) == 1000.0
    assert together_hz([quick, slow]) == 400.0
    assert together_hz([slow]) == 400.0


def test_units_are_those_of_the_channels_that_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver that accepts any name reports no units."""
    load = registry.load("simulated")
    has = ChannelUnits({"x": "µm", "y": "µm"}, {"x": "V", "y": "V"})
    before = probed(FakeClock(T0_NS)).units
    config = configured()
    monkeypatch.setattr(registry, "load", lambda _name: replace(load, channels=lambda _: has))
    after = probe(config, pairs_of(config.axes), FakeClock(T0_NS))["rig"].units

    assert before == ChannelUnits({}, {})
    assert after == ChannelUnits({"x": "µm"}, {"x": "V"})
