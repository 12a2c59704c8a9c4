from pathlib import Path

import pytest

from piezod.daemon.last_output import LastOutputReader, LastOutputWriter
from piezod.daemon.loop.timed_channels import NOT_WRITTEN, TimedChannels
from piezod.devices.channels import Channels
from piezod.devices.interface import Wiring
from piezod.devices.wiring import ChannelPair
from piezod.testing.fake_clock import READING_NS, FakeClock
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

AXES = ("x", "y")


@pytest.fixture
def clock() -> FakeClock:
    """Return the clock of the measurement."""
    return FakeClock(10**9)


@pytest.fixture
def timed(tmp_path: Path, clock: FakeClock) -> TimedChannels:
    """Return two simulated axes whose calls are measured, active."""
    pairs = {axis: ChannelPair("rig", "rig") for axis in AXES}
    channels = Channels({"rig": SimulatedRig(SimulatedOptions(), Wiring.both(AXES), 1)}, pairs)
    channels.open()
    timed = TimedChannels(channels, clock, LastOutputWriter(tmp_path / "output.map", len(AXES)))
    timed.activate(clock.now_ns())
    return timed


def test_devices_answer_as_they_do_without_it(timed: TimedChannels, clock: FakeClock) -> None:
    """Results of the devices pass through unchanged."""
    t_ns = clock.now_ns()

    assert [sample.t_ns for sample in timed.read(t_ns)] == [t_ns, t_ns]
    assert not timed.write([1.0, 1e6], t_ns)
    assert timed.read_back(t_ns) == pytest.approx([0.0, 0.0], abs=0.5)
    assert list(timed.status(t_ns)) == [frozenset()] * 4


def test_phases_add_up_until_the_next_start(timed: TimedChannels, clock: FakeClock) -> None:
    """The duration of reading includes reading back; reading the clock takes 50 ns."""
    timed.start()
    timed.read(clock.now_ns())
    timed.read_back(clock.now_ns())
    before_ns = clock.t_ns
    timed.write([1.0, 2.0], clock.now_ns())
    before = timed.read_ns, timed.write_ns, timed.write_begin_ns - before_ns

    timed.start()

    assert before == (2 * READING_NS, READING_NS, 2 * READING_NS)
    assert (timed.read_ns, timed.write_ns, timed.write_begin_ns) == (0, 0, NOT_WRITTEN)


def test_voltage_is_stored_before_it_is_written(timed: TimedChannels, tmp_path: Path) -> None:
    """A voltage that the device refuses is stored too, because it may be in force."""
    timed.write([1.0, 1e6], 10**10)

    assert [each.drive_v for each in LastOutputReader(tmp_path / "output.map").read()] == [1.0, 1e6]


def test_zero_is_passed_on(timed: TimedChannels, clock: FakeClock) -> None:
    """Positions count from the zero."""
    before_um = timed.read(clock.now_ns())[0].position_um

    timed.zero([5.0, 0.0], [0.0, 0.0])

    assert timed.read(clock.now_ns())[0].position_um == pytest.approx(before_um - 5.0, abs=0.1)


def test_deactivation_is_passed_on(timed: TimedChannels, clock: FakeClock) -> None:
    """Inactive devices refuse writes."""
    timed.deactivate(clock.now_ns())

    assert not timed.write([1.0, 1.0], clock.now_ns())
