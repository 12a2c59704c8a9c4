"""Manual driving of an axis."""

import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import count
from math import inf, nan, sin
from pathlib import Path

import numpy as np
import pytest

from piezod.commission.bench import one_axis
from piezod.commission.device_watch import PATIENCE_S
from piezod.commission.session import Session
from piezod.commission.session_trace import SessionTrace, joined
from piezod.control.guard import Limits
from piezod.daemon.output_notes import OutputNotes
from piezod.daemon.paths import StagePaths
from piezod.devices.interface import Device
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod.testing.fake_clock import FakeClock
from piezod.testing.faulty import FaultyDevice, FaultyError
from piezod.testing.injections import Injection, InjectionKind
from tests.commission.axes import T0_NS, configured, resting_at, session
from tests.daemon.waiting import eventually

SOON_NS = T0_NS + 2_100_000_000


def faulty(
    kind: InjectionKind, value: float = nan, flag: DeviceFlag = DeviceFlag.OVERLOAD
) -> FaultyDevice:
    """Return a wrapper that fails after a tenth of a second."""
    return lambda device: FaultyDevice(device, [Injection(kind, SOON_NS, value=value, flag=flag)])  # type: ignore[return-value] # a factory; the rig is both


@pytest.mark.parametrize("wished_v", [inf, -inf, nan, 1e9, -1e9])
@pytest.mark.parametrize("slew_v_per_s", [10.0, 1e4])
def test_the_limits_hold_for_any_waveform(wished_v: float, slew_v_per_s: float) -> None:
    """No voltage leaves the range or changes faster than the slew rate."""
    limits = Limits(0.0, 90.0, slew_v_per_s)
    with session(limits=limits) as axis:
        trace = axis.drive(lambda _t_s: wished_v, 0.05)

    steps_v = np.abs(np.diff(trace.drive_v))
    low_v = min(axis.found_v, 0.0)
    assert np.all((trace.drive_v >= low_v) & (trace.drive_v <= 90.0))
    assert np.all(steps_v <= slew_v_per_s * 1.01e-3)


def test_an_axis_returns_to_its_initial_voltage() -> None:
    """This holds from any voltage."""
    with session() as axis:
        axis.go(20.0)
        axis.drive(lambda t_s: 20.0 + 5.0 * sin(50.0 * t_s), 0.1)
        axis.back()

        assert axis.drive_v == pytest.approx(max(axis.found_v, 0.0), abs=1e-9)


def test_a_ramp_takes_its_time() -> None:
    """10 V at 50 V/s take 0.2 s, plus a short time at the end."""
    with session() as axis:
        trace = axis.go(10.0)

    assert trace.t_s[-1] == pytest.approx(0.25, abs=0.01)
    assert axis.drive_v == 10.0


@pytest.mark.parametrize(
    ("wrap", "text"),
    [
        (faulty(InjectionKind.REFUSED), "has refused 0.00 V for 2.0 s"),
        (faulty(InjectionKind.READ_BACK_OFFSET, 7.0), "read-back voltage differs by 7.0 V"),
        (
            faulty(InjectionKind.FLAGGED, flag=DeviceFlag.SHORT_OR_OPEN),
            "the device reports: short or open",
        ),
    ],
)
def test_a_device_that_does_not_follow_ends_a_step(wrap: FaultyDevice, text: str) -> None:
    """The message states what the device did."""
    with session(wrap=wrap) as axis, pytest.raises(DeviceError, match=text):  # type: ignore[arg-type] # a factory
        axis.rest(PATIENCE_S + 0.5)


def test_an_unknown_initial_voltage_is_refused() -> None:
    """An amplifier that reports no voltage is not driven."""
    with (
        pytest.raises(DeviceError, match="voltage in force is unknown"),
        session(wrap=lambda device: FaultyDevice(device, [_no_read_back()])),  # type: ignore[arg-type] # the rig is both
    ):
        pass


def test_samples_that_are_not_valid_are_left_out() -> None:
    """They reduce the share of valid samples."""
    with session(wrap=faulty(InjectionKind.DROPPED)) as axis:  # type: ignore[arg-type] # a factory
        trace = axis.rest(0.2)

    assert trace.valid_pct == pytest.approx(50.0, abs=2.0)


def test_joined_traces_have_one_time_axis() -> None:
    """The time rises throughout."""
    with session() as axis:
        trace = joined([_short(axis), _short(axis), _short(axis)])

    assert np.all(np.diff(trace.t_s) > 0)
    assert trace.t_s[-1] == pytest.approx(0.15, abs=0.01)


def _short(axis: Session) -> SessionTrace:
    return axis.rest(0.05)


def _no_read_back() -> Injection:
    return Injection(InjectionKind.READ_BACK_OFFSET, 0, value=nan)


def written_by(axis: Session, wrap: list[float]) -> None:
    """Record every voltage that an axis writes from now on."""
    write = axis._channels.write  # noqa: SLF001 - what goes to the devices

    def noting(drive_v: Sequence[float], now_ns: int) -> bool:
        wrap.append(drive_v[0])
        return write(drive_v, now_ns)

    axis._channels.write = noting  # type: ignore[method-assign] # noqa: SLF001 - likewise


def test_a_return_from_the_initial_voltage_writes_only_that() -> None:
    """No other voltage is written."""
    written: list[float] = []
    with session(wrap=resting_at(60.0)) as axis:
        written_by(axis, written)
        axis.back()
        axis.go(axis.drive_v)

    assert written == pytest.approx([60.0] * len(written), abs=0.5)


def test_an_axis_outside_its_limits_is_not_driven() -> None:
    """The message states its voltage and its limits."""
    with (
        pytest.raises(DeviceError, match=r"1[34]\d\.\d+ V are in force, .* limits of 0 to 100 V"),
        session(wrap=resting_at(140.0), limits=Limits(0.0, 100.0, 20_000.0)),
    ):
        pass


def test_a_pause_makes_no_step() -> None:
    """After a pause of a second the voltage changes by a period of the ramp."""
    with session() as axis:
        clock = axis._clock  # noqa: SLF001 - the test's own
        assert isinstance(clock, FakeClock)
        write = axis._channels.write  # noqa: SLF001 - to stop in the middle
        paused = False

        def pausing(drive_v: Sequence[float], now_ns: int) -> bool:
            nonlocal paused
            if drive_v[0] > 10.0 and not paused:
                paused = True
                clock.spend_ns(1_000_000_000)
            return write(drive_v, now_ns)

        axis._channels.write = pausing  # type: ignore[method-assign] # noqa: SLF001 - likewise
        trace = axis.go(20.0)

    assert paused
    assert np.max(np.abs(np.diff(trace.drive_v))) <= 50.0 / 1000.0 * 1.001


def test_refusals_that_end_in_time_cost_nothing_but_time() -> None:
    """A lost reply that blocks requests for 300 ms does not end the way back."""
    refused = Injection(InjectionKind.REFUSED, SOON_NS, SOON_NS + 300_000_000)
    with session(wrap=lambda device: FaultyDevice(device, [refused])) as axis:  # type: ignore[arg-type] # the rig is both
        trace = axis.go(10.0)
        axis.back()

    assert trace.t_s[-1] > 0.5
    assert axis.drive_v == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("flag", [DeviceFlag.WATCHDOG_TRIPPED, DeviceFlag.RESTARTED])
def test_a_voltage_that_something_else_has_changed_is_not_driven(flag: DeviceFlag) -> None:
    """The way back would be a step, so nothing more is written."""
    written: list[float] = []
    with session(wrap=faulty(InjectionKind.FLAGGED, flag=flag)) as axis:  # type: ignore[arg-type] # a factory
        with pytest.raises(DeviceError, match=str(flag)):
            axis.go(20.0)
        written_by(axis, written)
        with pytest.raises(DeviceError, match="left as it is"):
            axis.back()

    assert written == []


def test_the_voltage_is_held_during_a_wait() -> None:
    """A device that needs regular requests gets them."""
    written: list[float] = []
    with session() as axis:
        axis.go(5.0)
        written_by(axis, written)
        with axis.holding():
            eventually(lambda: len(written) > 10)

    assert set(written) == {5.0}


def test_a_fault_during_a_wait_is_raised() -> None:
    """The error comes at the end of the wait."""
    written: list[float] = []
    with session(wrap=faulty(InjectionKind.FLAGGED)) as axis:  # type: ignore[arg-type] # a factory
        written_by(axis, written)
        with pytest.raises(DeviceError, match="overload"), axis.holding():
            eventually(lambda: len(written) > 90)


def test_any_exception_of_a_driver_during_a_wait_is_raised() -> None:
    """This holds not only for piezod's own errors."""
    written: list[float] = []
    with session(wrap=faulty(InjectionKind.WRITE_RAISES)) as axis:  # type: ignore[arg-type] # a factory
        written_by(axis, written)
        with pytest.raises(FaultyError, match="while it wrote"), axis.holding():
            eventually(lambda: len(written) > 90)


@pytest.fixture
def interrupts() -> Iterator[None]:
    """Let SIGINT raise KeyboardInterrupt, whatever other tests of this process have set."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interrupts")
def test_only_one_thread_drives_on_the_way_back() -> None:
    """This also holds if a signal has ended the wait for the holding thread."""
    holding, going_back, together = threading.Event(), threading.Event(), list[bool]()
    waits = iter([0.5])  # long enough to catch code that does not wait for the other thread
    with session() as axis:
        write, this = axis._channels.write, threading.current_thread()  # noqa: SLF001 - as above
        main = threading.get_ident()

        def noting(drive_v: Sequence[float], now_ns: int) -> bool:
            if threading.current_thread() is this:
                together.append(holding.is_set())
                going_back.set()
                return write(drive_v, now_ns)
            holding.set()
            if (wait_s := next(waits, 0.0)) > 0.0:
                eventually(axis._holder.is_set)  # type: ignore[union-attr] # noqa: SLF001 - likewise
                signal.pthread_kill(main, signal.SIGINT)
                going_back.wait(wait_s)
            taken = write(drive_v, now_ns)
            holding.clear()
            return taken

        axis._channels.write = noting  # type: ignore[method-assign] # noqa: SLF001 - likewise
        with pytest.raises(KeyboardInterrupt), axis.holding():
            assert holding.wait(20.0)
        axis.back()

    assert together
    assert not any(together)


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 25.0])
def test_a_slow_axis_arrives(rate_hz: float) -> None:
    """A ramp lasts until its end is written, and has at least two samples."""
    with session(rate_hz=rate_hz) as axis:
        traces = [axis.go(20.0), axis.go(20.001), axis.drive(lambda _t_s: 20.0, 0.0)]
        there_v = axis.drive_v
        axis.back()

        assert axis.drive_v == pytest.approx(0.0, abs=1e-9)
    assert there_v == 20.0
    assert traces[0].drive_v[-1] == pytest.approx(20.0)
    assert np.all(np.diff(joined(traces).t_s) > 0)


def test_a_ramp_as_fast_as_the_slew_rate_arrives() -> None:
    """Late cycles delay neither the ramp nor the guard's slew limit."""
    with session(limits=Limits(0.0, 150.0, 50.0)) as axis:
        clock = axis._clock  # noqa: SLF001 - the test's own
        assert isinstance(clock, FakeClock)
        write, cycles = axis._channels.write, count()  # noqa: SLF001 - to be late

        def late(drive_v: Sequence[float], now_ns: int) -> bool:
            if next(cycles) % 3 == 0:
                clock.spend_ns(1_500_000)
            return write(drive_v, now_ns)

        axis._channels.write = late  # type: ignore[method-assign] # noqa: SLF001 - likewise
        trace = axis.go(20.0)

    assert axis.drive_v == pytest.approx(20.0)
    elapsed_s = np.diff(trace.t_s)[:-1]  # before each of the changes
    assert np.all(np.diff(trace.drive_v)[1:] <= 50.0 * elapsed_s * 1.01)


def test_a_return_that_ends_elsewhere_is_reported() -> None:
    """The message states the final voltage."""
    with session(limits=Limits(0.0, 150.0, 1000.0)) as axis:
        axis.go(20.0)
        axis.limits = Limits(0.0, 150.0, 10.0)
        with pytest.raises(DeviceError, match=r"back to 0\.0\d V ended at 1\d\.\d+ V"):
            axis.back()


def test_a_voltage_that_is_off_ends_many_short_rests() -> None:
    """The count continues over short rests; for a range of 10 V, one volt is too much."""
    off = Injection(InjectionKind.READ_BACK_OFFSET, SOON_NS, value=1.0)
    with (
        session(wrap=lambda one: FaultyDevice(one, [off]), limits=Limits(0.0, 10.0, 1e4)) as axis,  # type: ignore[arg-type] # the rig is both
        pytest.raises(DeviceError, match=r"differs by 1\.0 V"),
    ):
        for _ in range(10):
            axis.rest(0.02)


def test_an_amplifier_that_follows_late_is_not_off() -> None:
    """A delayed read-back is compared with recently written voltages."""
    with session() as axis:
        read_back, told = axis._channels.read_back, deque[list[float]](maxlen=80)  # noqa: SLF001 - to tell it late

        def late(now_ns: int) -> list[float]:
            told.append(read_back(now_ns))
            return told[0]

        axis._channels.read_back = late  # type: ignore[method-assign] # noqa: SLF001 - likewise
        axis.go(50.0)
        axis.drive(lambda t_s: 50.0 + 5.0 * sin(50.0 * t_s), 0.5)
        axis.rest(0.2)

    assert axis.drive_v == pytest.approx(50.0, abs=5.0)


def test_refusals_before_the_way_back_do_not_count_on_it() -> None:
    """The way back has its own patience."""
    refused = Injection(InjectionKind.REFUSED, SOON_NS, SOON_NS + 3_000_000_000)
    with session(wrap=lambda one: FaultyDevice(one, [refused])) as axis:  # type: ignore[arg-type] # the rig is both
        with pytest.raises(DeviceError, match="has refused"):
            axis.go(20.0)
        axis.back()

        assert axis.drive_v == pytest.approx(0.0, abs=1e-3)


def test_without_read_back_the_voltage_must_be_given() -> None:
    """The message states the option."""

    def silent(device: Device) -> Device:
        able = device.capabilities
        device.capabilities = lambda: able()._replace(read_back=False)  # type: ignore[method-assign] # of this one
        return device

    with pytest.raises(DeviceError, match="`piezod commission --output-v`"), session(wrap=silent):
        pass


def test_axis_without_a_sensor_is_not_commissioned(tmp_path: Path) -> None:
    """No device is opened: every step measures the displacement."""
    config = configured()
    axis = config.axes["x"].model_copy(update={"sensor": None})
    blind = config.model_copy(update={"axes": {"x": axis}})
    notes = OutputNotes(blind, StagePaths("stage", tmp_path, tmp_path))

    with (
        pytest.raises(DeviceError, match="axis x has no sensor, and commissioning"),
        one_axis(blind, "x", notes),
    ):
        pass
