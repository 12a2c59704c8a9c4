"""The driver contract: a correct device passes, and each breach is found by its check."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from piezod.devices.interface import Capabilities, Device, Identity, Sample
from piezod.errors import DeviceError
from piezod.testing import amplifier_checks, device_checks, sensor_checks, truth_checks
from piezod.testing.check_support import Check
from piezod.testing.driver_contract import checks_for


class PlainRig:
    """A sensor and amplifier of two axes whose displacement in µm equals the drive in V."""

    def __init__(self) -> None:
        self.drive_v = [0.0, 0.0]
        self.is_open = False
        self.is_active = False

    def open(self) -> Identity:
        """Open the rig."""
        self.require(not self.is_open, "already open")
        self.is_open = True
        return Identity("piezod", "plain rig", "1", "none")

    def capabilities(self) -> Capabilities:
        """Return the two axes."""
        self.require(self.is_open, "not open")
        return Capabilities(("x", "y"), ("x", "y"), read_back=True, max_rate_hz=1000.0)

    def activate(self, now_ns: int) -> None:  # noqa: ARG002 - the interface gives the time
        """Accept writes from now on."""
        self.require(self.is_open, "not open")
        self.is_active = True

    def deactivate(self, now_ns: int) -> None:  # noqa: ARG002 - the interface gives the time
        """Go to rest."""
        self.is_active = False
        self.drive_v = [0.0, 0.0]

    def close(self) -> None:
        """Go to rest and close."""
        self.deactivate(0)
        self.is_open = False

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Measure both axes."""
        self.require(self.is_active, "not active")
        return [Sample(now_ns, axis_v, valid=True) for axis_v in self.drive_v]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:  # noqa: ARG002 - as above
        """Drive both axes, or refuse."""
        if not self.is_active or len(drive_v) != 2 or not all(map(self.in_range, drive_v)):
            return False
        self.drive_v = list(drive_v)
        return True

    def read_back(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - as above
        """Return the drive of both axes."""
        self.require(self.is_open, "not open")
        return self.drive_v

    def in_range(self, axis_v: float) -> bool:
        """Return whether one axis can be driven to this value."""
        return math.isfinite(axis_v) and 0 <= axis_v <= 150

    def require(self, condition: bool, text: str) -> None:
        """Refuse a call out of order."""
        if not condition:
            raise DeviceError(text)


class ReadsFileWhenConstructed(PlainRig):
    """Reads a file before it is opened."""

    def __init__(self) -> None:
        super().__init__()
        Path(os.devnull).read_bytes()


class Nameless(PlainRig):
    """Has a blank serial number."""

    def open(self) -> Identity:
        """Return a blank serial number."""
        return super().open()._replace(serial=" ")


class WithoutAxes(PlainRig):
    """Has no axes."""

    def capabilities(self) -> Capabilities:
        """Return no axes."""
        return super().capabilities()._replace(inputs=(), outputs=())


class WithTwinAxes(PlainRig):
    """Has two axes of the same name."""

    def capabilities(self) -> Capabilities:
        """Return the same axis twice."""
        return super().capabilities()._replace(inputs=("x", "x"))


class WithoutRate(PlainRig):
    """Supports no loop rate."""

    def capabilities(self) -> Capabilities:
        """Return a rate of zero."""
        return super().capabilities()._replace(max_rate_hz=0.0)


class NeverRefuses(PlainRig):
    """Ignores the order of calls."""

    def require(self, condition: bool, text: str) -> None:
        """Accept everything."""


class ClosesOnce(PlainRig):
    """Cannot be closed a second time."""

    def close(self) -> None:
        """Refuse unless open."""
        self.require(self.is_open, "not open")
        super().close()


class OneSampleShort(PlainRig):
    """Returns no sample of its last axis."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Measure the first axis only."""
        return super().read(now_ns)[:-1]


class ValidNan(PlainRig):
    """Returns NaN as a valid sample."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return NaN."""
        return [sample._replace(position_um=math.nan) for sample in super().read(now_ns)]


class FromTheFuture(PlainRig):
    """Returns samples dated after the call."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return samples of a nanosecond from now."""
        return super().read(now_ns + 1)


class BackInTime(PlainRig):
    """Returns ever older samples."""

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return samples that get older with each call."""
        return super().read(2_000_000_000 - now_ns)


class WritesWhileInactive(PlainRig):
    """Accepts every write."""

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Drive without activation."""
        self.is_active = True
        return super().write(drive_v, now_ns)


class JumpsWhenActivated(PlainRig):
    """Drives without a write."""

    def activate(self, now_ns: int) -> None:
        """Drive one volt."""
        super().activate(now_ns)
        self.drive_v = [1.0, 1.0]


class IgnoresWrites(PlainRig):
    """Reports success of a write that it ignores."""

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Ignore the write."""
        taken = super().write(drive_v, now_ns)
        self.drive_v = [0.0, 0.0]
        return taken


class WritesGoodHalf(PlainRig):
    """Drives the axes with valid values and refuses only the others."""

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Accept the first axis before checking the second."""
        taken = super().write(drive_v, now_ns)
        if self.is_active and drive_v and self.in_range(drive_v[0]):
            self.drive_v[0] = drive_v[0]
        return taken


class AcceptsNan(PlainRig):
    """Accepts NaN as a drive voltage."""

    def in_range(self, axis_v: float) -> bool:
        """Accept every value that is not out of range."""
        return not (axis_v < 0 or axis_v > 150)


class HoldsWhenDeactivated(PlainRig):
    """Keeps its drive after deactivation."""

    def deactivate(self, now_ns: int) -> None:  # noqa: ARG002 - the interface gives the time
        """Refuse writes from now on, without going to rest."""
        self.is_active = False


class KnowingRig(PlainRig):
    """Knows the true displacement."""

    def true_position_um(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - as above
        """Return both axes."""
        self.require(self.is_active, "not active")
        return self.drive_v


class AlwaysKnows(KnowingRig):
    """Returns the true displacement while inactive too."""

    def true_position_um(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - as above
        """Return both axes at any time."""
        return self.drive_v


class OneTruthShort(KnowingRig):
    """Returns no true displacement of its last axis."""

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Return the first axis only."""
        return super().true_position_um(now_ns)[:-1]


class DoesNotKnowAfterAll(KnowingRig):
    """Returns NaN as the true displacement."""

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Return NaN."""
        return [math.nan for _ in super().true_position_um(now_ns)]


class DisturbedByQuestions(KnowingRig):
    """Moves when its true displacement is requested."""

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Move by a nanometre."""
        self.drive_v = [axis_v + 1e-3 for axis_v in super().true_position_um(now_ns)]
        return self.drive_v


BREACHES = [
    (ReadsFileWhenConstructed, device_checks.constructing_does_no_io),
    (Nameless, device_checks.opening_tells_the_identity),
    (WithoutAxes, device_checks.capabilities_make_sense),
    (WithTwinAxes, device_checks.capabilities_make_sense),
    (WithoutRate, device_checks.capabilities_make_sense),
    (NeverRefuses, device_checks.order_of_calls_is_enforced),
    (NeverRefuses, sensor_checks.reading_needs_an_active_sensor),
    (NeverRefuses, amplifier_checks.reading_back_needs_an_open_amplifier),
    (OneSampleShort, sensor_checks.every_axis_gives_one_sample),
    (ValidNan, sensor_checks.every_axis_gives_one_sample),
    (FromTheFuture, sensor_checks.samples_carry_their_time),
    (BackInTime, sensor_checks.samples_carry_their_time),
    (WritesWhileInactive, amplifier_checks.writing_needs_an_active_amplifier),
    (JumpsWhenActivated, amplifier_checks.activating_leaves_the_output_at_rest),
    (IgnoresWrites, amplifier_checks.a_write_comes_into_force),
    (WritesGoodHalf, amplifier_checks.a_bad_write_is_refused_as_a_whole),
    (AcceptsNan, amplifier_checks.a_bad_write_is_refused_as_a_whole),
    (HoldsWhenDeactivated, amplifier_checks.deactivating_brings_the_output_to_rest),
    (AlwaysKnows, truth_checks.truth_needs_an_active_sensor),
    (OneTruthShort, truth_checks.every_axis_has_one_truth),
    (DoesNotKnowAfterAll, truth_checks.every_axis_has_one_truth),
    (DisturbedByQuestions, truth_checks.asking_for_the_truth_changes_nothing),
]


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do not wait: these devices run on the simulated clock."""
    monkeypatch.setattr("piezod.testing.amplifier_bench.PATIENCE_S", 0.0)


@pytest.mark.parametrize("check", checks_for(KnowingRig), ids=lambda check: check.__name__)
def test_device_that_keeps_the_contract_passes(check: Check) -> None:
    """A plain rig that knows the truth passes every check."""
    check(KnowingRig)


def test_devices_without_true_displacement_skip_its_checks() -> None:
    """A device without true displacement passes all other checks."""
    without, knowing = checks_for(PlainRig), checks_for(KnowingRig)

    assert [check for check in knowing if check not in without] == list(truth_checks.TRUTH_CHECKS)


@pytest.mark.parametrize(("breach", "check"), BREACHES)
def test_breach_is_found(breach: type[PlainRig], check: Check) -> None:
    """A device that breaks one rule fails the check of that rule."""
    assert check in checks_for(KnowingRig)

    with pytest.raises(AssertionError):
        check(breach)


def test_error_while_ending_is_a_breach() -> None:
    """The error of a device that cannot be closed twice leaves the check."""
    with pytest.raises(DeviceError, match="not open"):
        device_checks.ending_succeeds_at_any_time(ClosesOnce)


def test_device_without_a_role_has_no_contract() -> None:
    """A device that is neither sensor nor amplifier is refused."""

    def factory() -> Device:
        return object()  # type: ignore[return-value]  # the mistake under test

    with pytest.raises(TypeError, match="object is neither a Sensor nor an Amplifier"):
        checks_for(factory)
