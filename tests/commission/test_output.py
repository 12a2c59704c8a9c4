"""The voltage from which an axis is driven, and the one by which it comes back."""

from collections.abc import Callable, Sequence
from itertools import count
from math import nan
from pathlib import Path

import numpy as np
import pytest

from piezod.commission.bench import one_axis
from piezod.commission.device_watch import PATIENCE_S
from piezod.commission.output import Output
from piezod.commission.session import Session
from piezod.control.guard import Limits
from piezod.daemon.last_output import LastOutputReader, LastOutputWriter
from piezod.daemon.noted_identities import noted_identities
from piezod.daemon.output_notes import OutputNotes
from piezod.daemon.paths import StagePaths
from piezod.devices.interface import Device
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod.testing.fake_clock import FakeClock
from piezod.testing.faulty import FaultyDevice
from piezod.testing.injections import Injection, InjectionKind
from piezod.units import NS_PER_S, s_to_ns
from piezod_drivers.simulated.driver import SimulatedRig
from tests.commission.axes import T0_NS, configured, resting_at, session

SOON_NS = T0_NS + 2_300_000_000
SLOW = Limits(0.0, 150.0, 200.0)
RATE_HZ = 50.0
TOLERANCE_V = SLOW.read_back_tolerance_v


def writes_of(axis: Session) -> list[float]:
    """Return the list of the voltages that reach the devices from now on."""
    write, written = axis._channels.write, list[float]()  # noqa: SLF001 - what goes to the devices

    def noting(drive_v: Sequence[float], now_ns: int) -> bool:
        written.append(drive_v[0])
        return write(drive_v, now_ns)

    axis._channels.write = noting  # type: ignore[method-assign] # noqa: SLF001 - likewise
    return written


def failing(*injections: Injection, left_v: float = 0.0) -> Callable[[Device], Device]:
    """Return a wrapper of a rig that rests at a voltage and has faults."""
    return lambda device: FaultyDevice(resting_at(left_v)(device), injections)  # type: ignore[arg-type] # the rig is both


@pytest.mark.parametrize("last_v", [0.0, 57.0, 140.0])
def test_a_read_back_unlike_the_last_write_is_not_driven(last_v: float) -> None:
    """Nothing tells which of them is in force: the error has both, and what a person may do."""
    with (
        pytest.raises(
            DeviceError, match=rf"read-back [56]\d\S* V, last write {last_v:g} V .*--confirm-output"
        ),
        session(wrap=resting_at(60.0), last_v=last_v),
    ):
        pass


@pytest.mark.parametrize("last_v", [nan, 60.0])
def test_a_read_back_that_nothing_contradicts_is_the_start(last_v: float) -> None:
    """It counts if it agrees with the last write, or if that is not known."""
    with session(wrap=resting_at(60.0), last_v=last_v) as axis:
        assert axis.found_v == pytest.approx(60.0, abs=TOLERANCE_V)


def test_a_restart_that_the_amplifier_reports_decides() -> None:
    """Its output has fallen since the last write, and the read-back is in force."""
    restarted = Injection(InjectionKind.FLAGGED, 0, flag=DeviceFlag.RESTARTED)
    with session(wrap=failing(restarted), last_v=60.0) as axis:
        assert axis.found_v == pytest.approx(0.0, abs=TOLERANCE_V)


@pytest.mark.parametrize(("left_v", "last_v"), [(20.0, 60.0), (60.0, 20.0)])
def test_a_watchdog_explains_a_fall_towards_rest_only(left_v: float, last_v: float) -> None:
    """An output that has risen by itself stays a contradiction."""
    with session(wrap=resting_at(left_v)) as axis:
        clock = axis._clock  # noqa: SLF001 - the test's own
        output = Output(axis._channels, TOLERANCE_V, clock, last_v, rest_v=0.0)  # noqa: SLF001 - likewise
        if left_v > last_v:
            with pytest.raises(DeviceError, match="left as it is"):
                output.find()
        else:
            output.find()
            assert output.drive_v == pytest.approx(left_v, abs=TOLERANCE_V)


def test_the_way_back_starts_only_where_read_back_and_last_write_agree() -> None:
    """A difference above the tolerance leaves the voltage as it is, and nothing is driven."""
    off = Injection(InjectionKind.READ_BACK_OFFSET, SOON_NS, value=3.0 * TOLERANCE_V)
    with session(wrap=failing(off), limits=SLOW, rate_hz=RATE_HZ) as axis:
        axis.go(10.0)
        axis._clock.sleep_until_ns(SOON_NS)  # noqa: SLF001 - the test's own
        written = writes_of(axis)
        with pytest.raises(DeviceError, match=r"last write 10 V .*--confirm-output"):
            axis.back()

    assert written == []


def test_the_way_back_waits_for_an_output_that_follows_late() -> None:
    """A read-back that reaches the last write in time is no contradiction."""
    for_s = PATIENCE_S / 2
    off = Injection(InjectionKind.READ_BACK_OFFSET, SOON_NS, SOON_NS + s_to_ns(for_s), value=5.0)
    with session(wrap=failing(off)) as axis:
        axis.go(10.0)
        axis._clock.sleep_until_ns(SOON_NS)  # noqa: SLF001 - the test's own
        axis.back()

        assert axis.drive_v == pytest.approx(0.0, abs=1e-9)


def test_a_read_back_that_is_missing_at_times_is_compared_nevertheless() -> None:
    """The error has the last one that came, and does not say that there was none."""
    with session(wrap=resting_at(60.0)) as axis:
        read_back, asked = axis._channels.read_back, count()  # noqa: SLF001 - which it reports once

        def once(now_ns: int) -> list[float]:
            return read_back(now_ns) if next(asked) == 3 else [nan]

        axis._channels.read_back = once  # type: ignore[method-assign] # noqa: SLF001 - likewise
        output = Output(axis._channels, TOLERANCE_V, axis._clock, 20.0)  # noqa: SLF001 - likewise
        with pytest.raises(DeviceError, match=r"read-back [56]\d\S* V, last write 20 V"):
            output.find()


def test_a_write_without_acknowledgement_may_be_in_force() -> None:
    """The way back starts there if it is read back."""
    with session(limits=SLOW, rate_hz=RATE_HZ) as axis:
        write = axis._channels.write  # noqa: SLF001 - whose reply is lost

        def unanswered(drive_v: Sequence[float], now_ns: int) -> bool:
            write(drive_v, now_ns)
            return drive_v[0] < 2.0

        axis._channels.write = unanswered  # type: ignore[method-assign] # noqa: SLF001 - likewise
        with pytest.raises(DeviceError):
            axis.drive(lambda t_s: 150.0 * t_s, 1.0)
        acknowledged_v, there_v = axis.drive_v, axis._output.read_back_v(axis._clock.now_ns())  # noqa: SLF001 - likewise
        axis._channels.write = write  # type: ignore[method-assign] # noqa: SLF001 - likewise
        axis.back()

        assert there_v - acknowledged_v > TOLERANCE_V
        assert axis.drive_v == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("late_ns", [0, 15_000_000])
def test_no_write_is_far_from_an_output_that_is_stuck(late_ns: int) -> None:
    """It is within a step of the slew rate and the tolerance; a late cycle reaches no farther."""
    stuck = Injection(InjectionKind.STUCK_OUTPUT, SOON_NS)
    with session(wrap=failing(stuck), limits=SLOW, rate_hz=RATE_HZ) as axis:
        clock, read = axis._clock, axis._channels.read  # noqa: SLF001 - the test's own
        assert isinstance(clock, FakeClock)

        def late(now_ns: int) -> object:
            clock.spend_ns(late_ns)
            return read(now_ns)

        axis._channels.read = late  # type: ignore[assignment, method-assign] # noqa: SLF001 - likewise
        written = writes_of(axis)
        with pytest.raises(DeviceError):
            axis.go(100.0)
        there_v = axis._output.read_back_v(clock.now_ns())  # noqa: SLF001 - likewise

    assert 0.0 < there_v < 100.0
    assert max(written) - there_v <= SLOW.slew_v_per_s / RATE_HZ + TOLERANCE_V


def test_a_late_cycle_makes_no_larger_step() -> None:
    """The waveform waits for the time that was lost."""
    with session(limits=SLOW, rate_hz=RATE_HZ) as axis:
        clock = axis._clock  # noqa: SLF001 - the test's own
        assert isinstance(clock, FakeClock)
        sleep, cycles = clock.sleep_until_ns, iter(range(10**6))

        def oversleep(t_ns: int) -> None:
            late = next(cycles) % 5 == 0
            sleep(t_ns + late * round(0.9 * NS_PER_S / RATE_HZ))

        clock.sleep_until_ns = oversleep  # type: ignore[method-assign] # of this one
        trace = axis.go(20.0)

    assert axis.drive_v == pytest.approx(20.0)
    assert np.max(np.diff(trace.drive_v)) <= 50.0 / RATE_HZ * 1.001


def test_each_voltage_is_noted_for_the_next_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is where daemon and `safe` store theirs, with the device, before it is written."""
    config, paths = configured(), StagePaths("stage", tmp_path, tmp_path)
    written, noted, write = list[float](), list[float](), SimulatedRig.write

    def noting(rig: SimulatedRig, drive_v: Sequence[float], now_ns: int) -> bool:
        noted.extend(each.drive_v for each in LastOutputReader(paths.output_map).read())
        written.append(drive_v[0])
        return write(rig, drive_v, now_ns)

    monkeypatch.setattr(SimulatedRig, "write", noting)
    with one_axis(config, "x", OutputNotes(config, paths), clock=FakeClock(T0_NS)) as opened:
        (found,) = LastOutputReader(paths.output_map).read()
        opened.session.go(5.0)

    assert found.drive_v == opened.session.found_v
    assert max(written) == pytest.approx(5.0, abs=TOLERANCE_V)
    assert noted == written
    assert list(noted_identities(paths.identities)) == ["rig"]


def test_a_watchdog_brings_the_output_to_rest_and_not_to_the_safe_voltage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a crash too, its fall contradicts no last write."""
    config, paths, able = (
        configured(),
        StagePaths("stage", tmp_path, tmp_path),
        SimulatedRig.capabilities,
    )
    x = config.axes["x"]
    x = x.model_copy(update={"safety": x.safety.model_copy(update={"safe_v": 75.0})})
    config = config.model_copy(update={"axes": {"x": x}})
    monkeypatch.setattr(
        SimulatedRig,
        "capabilities",
        lambda rig: able(rig)._replace(watchdog=True, holds=True, opens_relaxed=False),
    )
    paths.running.touch()
    LastOutputWriter(paths.output_map, 1).note([60.0], 1)
    with one_axis(config, "x", OutputNotes(config, paths), clock=FakeClock(T0_NS)) as opened:
        assert opened.session.found_v == pytest.approx(0.0, abs=TOLERANCE_V)
