"""Tests of one axis in one cycle: normalisation, look-ahead, limits, and the voltage in force."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from piezod.config.modes import Mode
from piezod.control.guard import Limits
from piezod.control.law.axis import CompensatedAxis
from piezod.control.law.compensator import Compensator, DriveHistory
from piezod.control.law.identifier import Identifier
from piezod.control.law.learned_models import ModelProof
from piezod.control.law.trim import Trim
from piezod.control.reference.preview import ReferenceShaper
from piezod.devices.interface import Sample
from piezod.hysteresis import AffineRange, Convergence, LearnedModel, StopForm
from tests.control.fakes import MS, FakeGate, FakeTrim, RecordingIdentifier

DRIVE_V = AffineRange(0.0, 150.0)
POSITION_UM = AffineRange(0.0, 10.0)
WIDE = Limits(0.0, 150.0, 1e9)
SLOW = Limits(0.0, 150.0, 2000.0)  # 2 V in a cycle
START_NS = 500 * MS
AT_REST = Sample(0, 0.0, valid=True)
FORM = StopForm.even(1)


def compensated(
    reference_um: Callable[[float], float],
    limits: Limits = WIDE,
    *,
    lms: RecordingIdentifier | None = None,
    gate: FakeGate | None = None,
    trim: Trim | None = None,
    in_force_v: float = 0.0,
    delay_ns: int = MS // 2,
    sensor_delay_ns: int = 0,
    weights: tuple[float, float] = (0.0, 0.0),
    first_mode_hz: float | None = None,
) -> CompensatedAxis:
    """Return an axis; without weights its drive is in proportion, 15 V per micrometre."""
    history = DriveHistory(in_force_v, entries=256)
    identifier = Identifier(
        lms or RecordingIdentifier(),
        DRIVE_V,
        POSITION_UM,
        history,
        delay_ns,
        MS,
        Convergence(0.1, window=2),
        gate or FakeGate(),
    )
    return CompensatedAxis(
        reference_um=reference_um,
        drive_v=DRIVE_V,
        position_um=POSITION_UM,
        compensator=Compensator(FORM, np.array(weights), mode=Mode.FEEDFORWARD, fade_cycles=1),
        identifier=identifier,
        history=history,
        limits=limits,
        in_force_v=in_force_v,
        start_ns=START_NS,
        period_ns=MS,
        delay_ns=delay_ns,
        sensor_delay_ns=sensor_delay_ns,
        trim=trim or FakeTrim(),
        proof=ModelProof(LearnedModel(np.array(weights)), window_cycles=1000, lag_cycles=3),
        shaper=ReferenceShaper(1e-3, first_mode_hz),
    )


def test_drive_follows_the_reference_one_period_and_one_delay_ahead() -> None:
    """A write at 3 ms shows at 4.5 ms; the record has the command of 3 ms."""
    output = compensated(lambda t_s: 1000 * t_s).update(START_NS + 3 * MS, AT_REST)

    assert output.drive_v == pytest.approx(15 * 4.5)
    assert output.command_um == pytest.approx(3.0)
    assert output.uncompensated_v == pytest.approx(15 * 3.0)


def test_sensor_delay_is_not_read_ahead() -> None:
    """The stage itself arrives earlier than its sensor shows."""
    axis = compensated(lambda t_s: 1000 * t_s, delay_ns=MS // 2, sensor_delay_ns=MS // 5)

    assert axis.update(START_NS + 3 * MS, AT_REST).drive_v == pytest.approx(15 * 4.3)


def test_corners_are_rounded_in_the_drive_only() -> None:
    """At 500 Hz each neighbour has a weight of 0.25; record and trim use the reference itself."""
    trim = FakeTrim()
    axis = compensated(
        lambda t_s: max(0.0, 1000 * t_s - 4.5), trim=trim, delay_ns=MS // 2, first_mode_hz=500.0
    )
    outputs = []
    for k in range(6):
        outputs.append(axis.update(START_NS + k * MS, Sample(START_NS + k * MS, 0.0, valid=True)))
        axis.applied(outputs[-1].drive_v)

    drives_v = [output.drive_v for output in outputs]
    commands_um = [output.command_um for output in outputs]
    assert drives_v == pytest.approx([0.0, 0.0, 0.0, 15 * 0.25, 15 * 1.0, 15 * 2.0])
    assert commands_um == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    assert trim.errors == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 0.05])


def test_drive_climbs_at_the_slew_rate() -> None:
    """A step of the reference becomes a ramp of the voltage in force."""
    axis = compensated(lambda _: 10.0, SLOW)
    drives_v = []
    for k in range(4):
        drives_v.append(axis.update(START_NS + k * MS, AT_REST).drive_v)
        axis.applied(drives_v[-1])

    assert drives_v == pytest.approx([2.0, 4.0, 6.0, 8.0])


def test_voltage_that_was_not_applied_does_not_count() -> None:
    """After a refused write the slew rate counts from the voltage still in force."""
    axis = compensated(lambda _: 10.0, SLOW)
    axis.update(START_NS, AT_REST)

    output = axis.update(START_NS + MS, AT_REST)

    assert output.in_force_v == 0.0
    assert output.drive_v == pytest.approx(2.0)


def test_memory_does_not_advance_while_writes_are_refused() -> None:
    """After half a swing of refused writes, the drive is that of a stage that stood still."""

    def swing(t_s: float) -> float:
        return 5.0 - 5.0 * math.cos(math.tau * t_s)

    def swing_with_a_stop(t_s: float) -> float:
        return swing(0.3) if 0.3 <= t_s < 0.8 else swing(t_s)

    refused = compensated(swing, weights=(0.4, 0.3), delay_ns=0)
    stopped = compensated(swing_with_a_stop, weights=(0.4, 0.3), delay_ns=0)
    apart_v = []
    for k in range(1500):
        t_ns = START_NS + k * MS
        refused_v = refused.update(t_ns, AT_REST).drive_v
        stopped_v = stopped.update(t_ns, AT_REST).drive_v
        stopped.applied(stopped_v)
        if not 300 <= k < 799:
            refused.applied(refused_v)
            apart_v.append(refused_v - stopped_v)

    assert np.max(np.abs(apart_v)) < 1e-9  # a memory that advanced would be 12 V off


def test_reference_that_is_not_a_number_holds_the_drive() -> None:
    """A reference that becomes NaN moves nothing."""
    axis = compensated(lambda t_s: 5.0 if t_s < 3e-3 else math.nan)
    for k in range(4):
        output = axis.update(START_NS + k * MS, AT_REST)
        axis.applied(output.drive_v)

    assert output.drive_v == pytest.approx(75.0)


def test_identifier_gets_the_voltage_before_the_delay() -> None:
    """A sample belongs to the voltage that was in force half a period earlier."""
    lms = RecordingIdentifier()
    axis = compensated(lambda t_s: 1000 * t_s, lms=lms)
    for k in range(4):
        axis.applied(axis.update(START_NS + k * MS, Sample(START_NS + k * MS, 5.0, True)).drive_v)

    # written at 0, 1, 2 ms: 22.5, 37.5, 52.5 V, each in force a cycle later
    in_force = np.array([0.0, 0.0, 22.5, 37.5, 52.5]) / 150
    assert [x for x, _ in lms.pairs] == [0.5] * 4
    assert [v for _, v in lms.pairs] == pytest.approx((in_force[1:] + in_force[:-1]) / 2)


def test_first_weights_that_converge_become_the_model() -> None:
    """A stage without a model gets the identified weights when they have converged."""
    lms = RecordingIdentifier(errors=[0.5, 0.5, 0.5])
    axis = compensated(lambda _: 5.0, lms=lms)
    lms.weights[:] = (0.02, 0.03)
    adopted = []
    for k in range(4):
        axis.update(START_NS + k * MS, AT_REST)
        adopted.append(axis.compensator.weights.tolist())

    assert adopted[1] == [0.0, 0.0]
    assert adopted[-1] == [0.02, 0.03]


def test_gate_gets_the_age_of_the_sample_and_whether_the_drive_was_limited() -> None:
    """The drive in force counts, which was requested one cycle earlier."""
    gate = FakeGate()
    axis = compensated(lambda _: 3.0 / 15.0, SLOW, gate=gate)
    for k in range(4):
        t_ns = START_NS + k * MS
        axis.applied(axis.update(t_ns, Sample(t_ns - 10 * k, 0.0, valid=True)).drive_v)

    assert gate.asked == [(True, 0, False), (True, 10, True), (True, 20, False), (True, 30, False)]


def test_trim_compares_a_sample_with_the_command_of_the_instant_it_shows() -> None:
    """That instant is the time of the sample minus the delay of the sensor."""
    trim = FakeTrim()
    axis = compensated(lambda t_s: 1000 * t_s, trim=trim, sensor_delay_ns=MS // 5)
    taken_ns = START_NS + 3 * MS - MS // 2

    axis.update(START_NS + 3 * MS, Sample(taken_ns, 2.3, valid=True))
    axis.update(START_NS + 4 * MS, Sample(taken_ns, 1.3, valid=True))

    assert trim.errors == pytest.approx([0.0, 0.1], abs=1e-12)


def test_trim_skips_samples_that_are_not_credible() -> None:
    """The gate decides, not the flag of the device."""
    trim, gate = FakeTrim(), FakeGate()
    axis = compensated(lambda _: 0.0, trim=trim, gate=gate)
    for k, gate.credible in enumerate((True, False, True)):
        axis.applied(axis.update(START_NS + k * MS, AT_REST).drive_v)

    assert trim.valid == [True, False, True]


def test_trim_holds_after_a_refused_write() -> None:
    """The requested voltage is not in force, so the sample does not show its effect."""
    trim = FakeTrim()
    axis = compensated(lambda _: 0.0, trim=trim)
    for k in range(3):
        output = axis.update(START_NS + k * MS, AT_REST)
        if k != 1:
            axis.applied(output.drive_v)

    assert trim.valid == [True, True, False]


def test_trim_gets_the_direction_that_is_limited() -> None:
    """While the slew rate limits the drive, the trim must not wind up."""
    trim = FakeTrim()
    axis = compensated(lambda t_s: 0.3 if t_s < 4e-3 else 0.0, SLOW, trim=trim)
    for k in range(7):
        axis.applied(axis.update(START_NS + k * MS, AT_REST).drive_v)

    assert trim.limited == [0, 1, 1, 0, -1, -1, 0]
