"""Tests of driving an axis by hand."""

from math import inf, nan, sin

import numpy as np
import pytest

from piezod.commission.session import MOST_REFUSALS, Session, Trace, joined
from piezod.control.limits import Limits
from piezod.devices.faulty import FaultyDevice
from piezod.devices.injections import Injection, Kind
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from tests.commission.axes import T0_NS, session

SOON_NS = T0_NS + 100_000_000


def faulty(kind: Kind, value: float = nan, flag: DeviceFlag = DeviceFlag.OVERLOAD) -> FaultyDevice:
    """Return a wrapper that fails from a tenth of a second on."""
    return lambda device: FaultyDevice(device, [Injection(kind, SOON_NS, value=value, flag=flag)])  # type: ignore[return-value] # a factory; the rig is both


@pytest.mark.parametrize("wished_v", [inf, -inf, nan, 1e9, -1e9])
@pytest.mark.parametrize("slew_v_per_s", [10.0, 1e4])
def test_whatever_a_step_asks_for_the_limits_hold(wished_v: float, slew_v_per_s: float) -> None:
    """No voltage leaves the range, and none changes faster than the slew rate."""
    limits = Limits(0.0, 90.0, slew_v_per_s)
    with session(limits=limits) as axis:
        trace = axis.drive(lambda _t_s: wished_v, 0.05)

    steps_v = np.abs(np.diff(trace.drive_v))
    low_v = min(axis.found_v, 0.0)
    assert np.all((trace.drive_v >= low_v) & (trace.drive_v <= 90.0))
    assert np.all(steps_v <= slew_v_per_s * 1.01e-3)


def test_an_axis_goes_back_to_where_it_was_found() -> None:
    """Wherever a step has left it."""
    with session() as axis:
        axis.go(20.0)
        axis.drive(lambda t_s: 20.0 + 5.0 * sin(50.0 * t_s), 0.1)
        axis.back()

        assert axis.drive_v == pytest.approx(max(axis.found_v, 0.0), abs=1e-9)


def test_a_ramp_takes_its_time() -> None:
    """10 V at 50 V/s take 0.2 s, and a little for the end."""
    with session() as axis:
        trace = axis.go(10.0)

    assert trace.t_s[-1] == pytest.approx(0.25, abs=0.01)
    assert axis.drive_v == 10.0


@pytest.mark.parametrize(
    ("wrap", "text"),
    [
        (faulty(Kind.REFUSED), f"refuses 0.00 V, {MOST_REFUSALS} times"),
        (faulty(Kind.READ_BACK_OFFSET, 7.0), "the voltage read back is 7.0 V off"),
        (faulty(Kind.FLAGGED, flag=DeviceFlag.SHORT_OR_OPEN), "the device says: short or open"),
    ],
)
def test_a_device_that_does_not_do_what_it_is_told_ends_a_step(
    wrap: FaultyDevice, text: str
) -> None:
    """The error says what it did instead."""
    with session(wrap=wrap) as axis, pytest.raises(DeviceError, match=text):  # type: ignore[arg-type] # a factory
        axis.rest(0.5)


def test_an_unknown_voltage_is_no_place_to_begin() -> None:
    """An amplifier that tells none is not driven."""
    with (
        pytest.raises(DeviceError, match="not known which voltage is in force"),
        session(wrap=lambda device: FaultyDevice(device, [_no_read_back()])),  # type: ignore[arg-type] # the rig is both
    ):
        pass


def test_samples_that_are_not_valid_are_left_out() -> None:
    """They count in the share of valid ones."""
    with session(wrap=faulty(Kind.DROPPED)) as axis:  # type: ignore[arg-type] # a factory
        trace = axis.rest(0.2)

    assert trace.valid_pct == pytest.approx(50.0, abs=2.0)


def test_joined_traces_have_one_time_axis() -> None:
    """It rises all the way."""
    with session() as axis:
        trace = joined([_short(axis), _short(axis), _short(axis)])

    assert np.all(np.diff(trace.t_s) > 0)
    assert trace.t_s[-1] == pytest.approx(0.15, abs=0.01)


def _short(axis: Session) -> Trace:
    return axis.rest(0.05)


def _no_read_back() -> Injection:
    return Injection(Kind.READ_BACK_OFFSET, 0, value=nan)
