"""Tests of the pairs that the learning algorithm gets."""

import math

import numpy as np
import pytest

from piezod.config.gate_reasons import GateReason
from piezod.control.law.compensator import DriveHistory
from piezod.control.law.creep import CreepState
from piezod.control.law.identifier import Identifier, LearningGate
from piezod.devices.interface import Sample
from piezod.hysteresis import AffineRange, Convergence
from piezod.hysteresis.creep import Creep
from tests.control.fakes import MS, FakeGate, RecordingIdentifier

DRIVE_V = AffineRange(0.0, 100.0)
POSITION_UM = AffineRange(-5.0, 5.0)


def identifier(
    lms: RecordingIdentifier, delay_ns: int = 0, cycles: int = 10, gate: FakeGate | None = None
) -> Identifier:
    """Return an identifier of a stage whose voltage was k volts at k milliseconds."""
    history = DriveHistory(0.0, entries=256)
    for k in range(cycles):
        history.append(k * MS, float(k))
    convergence = Convergence(0.1, window=2)
    gate = gate or FakeGate()
    return Identifier(lms, DRIVE_V, POSITION_UM, history, delay_ns, MS, convergence, gate)


def learn(subject: Identifier, position_um: float = 0.0, valid: bool = True) -> None:
    """Give an identifier a sample at 8 ms."""
    subject.learn(8 * MS, Sample(8 * MS, position_um, valid), limited=False, expected=0.3)


def test_pair_is_normalised() -> None:
    """Position and voltage arrive in units of their ranges."""
    lms = RecordingIdentifier()

    learn(identifier(lms), 2.5)

    assert lms.pairs == [(0.75, 0.08)]


@pytest.mark.parametrize(
    ("delay_ns", "drive_v"), [(0, 8.0), (MS, 7.0), (MS // 4, 7.75), (3 * MS + 1, 5.0), (99 * MS, 0)]
)
def test_sample_is_paired_with_the_voltage_one_delay_before(delay_ns: int, drive_v: float) -> None:
    """The voltage is the one in force one delay before the sample was taken."""
    lms = RecordingIdentifier()

    learn(identifier(lms, delay_ns))

    assert [drive for _, drive in lms.pairs] == pytest.approx([drive_v / 100], abs=1e-7)


@pytest.mark.parametrize(
    ("delay_ns", "drives_v"),
    [(-MS // 2, [None, 8.5, 9.5]), (-MS, [None, 9.0, 10.0]), (-3 * MS // 2, [None, None, 9.5])],
)
def test_early_sample_waits_for_its_voltage(delay_ns: int, drives_v: list[float | None]) -> None:
    """With a negative delay a sample is paired as soon as the voltage that it answers is known."""
    lms, history = RecordingIdentifier(errors=[0.0] * 3), DriveHistory(0.0, entries=8)
    subject = Identifier(lms, DRIVE_V, POSITION_UM, history, delay_ns, MS, None, FakeGate())

    learned: list[float | None] = []
    for k in (8, 9, 10):
        history.append(k * MS, float(k))
        before = len(lms.pairs)
        subject.learn(k * MS, Sample(k * MS, 0.0, True), limited=False, expected=0.3)
        learned += [100.0 * drive for _, drive in lms.pairs[before:]] or [None]

    assert learned == [drive and pytest.approx(drive, abs=1e-7) for drive in drives_v]


def test_early_sample_is_not_learned_from_if_the_gate_closes_before_its_voltage_is_known() -> None:
    """It may be what spoilt the voltage that the sample waited for."""
    lms, gate = RecordingIdentifier(errors=[0.0] * 3), FakeGate()
    subject = identifier(lms, -MS // 2, gate=gate)

    learn(subject)
    gate.reason = GateReason.LIMITED
    learn(subject)

    assert lms.learned == [False]
    assert subject.compared is None


def test_samples_that_wait_do_not_count_from_a_zero_of_later() -> None:
    """They are dropped when the present displacement becomes zero."""
    lms = RecordingIdentifier(errors=[0.0] * 3)
    subject = identifier(lms, -MS // 2)

    learn(subject)
    subject.zero(0.0, 0.0)
    learn(subject)

    assert lms.pairs == []


def test_age_of_a_sample_counts() -> None:
    """A sample that was taken before the cycle is paired with an earlier voltage."""
    lms, gate = RecordingIdentifier(), FakeGate()
    sample = Sample(8 * MS - MS // 2, 0.0, valid=True)

    identifier(lms, MS, gate=gate).learn(8 * MS, sample, limited=True, expected=0.3)

    assert [drive for _, drive in lms.pairs] == pytest.approx([0.065])
    assert gate.asked == [(True, MS // 2, True)]


@pytest.mark.parametrize("reason", [GateReason.LIMITED, GateReason.QUIET, GateReason.REPEATED])
def test_sample_that_is_not_learned_from_still_enters_the_memory(reason: GateReason) -> None:
    """The algorithm gets it without learning; the convergence stays as it was."""
    lms, gate = RecordingIdentifier(errors=[0.0] * 3), FakeGate()
    subject = identifier(lms, gate=gate)
    for _ in range(3):
        learn(subject)

    gate.reason = reason
    learn(subject, 3.0)

    assert lms.learned == [True, True, True, False]
    assert lms.pairs[-1][0] == pytest.approx(0.8)
    assert subject.converged


@pytest.mark.parametrize(("position_um", "valid"), [(math.nan, False), (4.0, True)])
def test_expected_position_replaces_a_sample_that_is_not_accurate(
    position_um: float, valid: bool
) -> None:
    """The memory gets the expected displacement; the convergence stays as it was."""
    lms, gate = RecordingIdentifier(errors=[0.0] * 3), FakeGate()
    subject = identifier(lms, gate=gate)
    for _ in range(3):
        learn(subject, -2.0)  # as expected

    gate.reason, gate.accurate = GateReason.SPIKE, False
    learn(subject, position_um, valid)

    assert lms.pairs[-1] == (0.3, 0.08)
    assert lms.learned == [True, True, True, False]
    assert subject.converged


@pytest.mark.fault("S3")
@pytest.mark.parametrize("far_um", [-500.0, -8.0, 8.0, 500.0])
def test_impossible_position_makes_no_creep(far_um: float) -> None:
    """At rest, where S3 is not reported, a model expects the stage where it was."""
    lms = RecordingIdentifier()
    creep = CreepState(Creep(np.array([0.1]), np.array([0.5])), np.zeros(1), 0.0, 0.0)
    history, gate = DriveHistory(0.0, entries=8), LearningGate(MS)
    subject = Identifier(lms, DRIVE_V, POSITION_UM, history, 0, MS, None, gate, creep)
    for position_um in (far_um, far_um, far_um, -5.0):
        subject.learn(8 * MS, Sample(8 * MS, position_um, True), limited=True, expected=0.0)

    assert [position for position, _ in lms.pairs] == [0.0] * 4
    assert not any(lms.learned)


def test_convergence_ends_with_a_disturbance() -> None:
    """The convergence holds up to the last sample: a disturbance ends it."""
    subject = identifier(RecordingIdentifier(errors=[0.5, 0.5, 0.5, 0.9, 0.9]))
    converged = []
    for _ in range(5):
        learn(subject)
        converged.append(subject.converged)

    assert converged == [False, False, True, False, False]


def test_rest_does_not_count_for_convergence() -> None:
    """Only motion counts, however small the differences at rest are."""
    lms = RecordingIdentifier(errors=[0.5] * 6)
    subject = identifier(lms)
    lms.at_rest = True
    for _ in range(3):
        learn(subject)
    assert not subject.converged

    lms.at_rest = False
    for _ in range(3):
        learn(subject)

    assert subject.converged


def test_weights_are_those_of_the_algorithm() -> None:
    """The weights are the same array, so that following them costs no copy."""
    lms = RecordingIdentifier()

    assert identifier(lms).weights is lms.weights


@pytest.mark.fault("D6")
def test_identifier_with_halved_gain_learns_from_every_second_sample() -> None:
    """The other samples only enter the memory."""
    lms = RecordingIdentifier()
    subject = identifier(lms)
    subject.gain_halved = True
    for _ in range(4):
        learn(subject)
    subject.gain_halved = False
    for _ in range(2):
        learn(subject)

    assert lms.learned == [False, True, False, True, True, True]


def test_missing_sample_is_as_far_from_the_model_as_those_before() -> None:
    """A step to the displacement of the model and back would be an extremum of its own."""
    lms, gate = RecordingIdentifier(errors=[0.0] * 101), FakeGate()
    subject = identifier(lms, gate=gate)
    sample = Sample(8 * MS, 0.35, valid=True)

    for _ in range(100):
        subject.learn(8 * MS, sample, limited=False, expected=0.3)
    gate.accurate = False
    subject.learn(8 * MS, sample._replace(valid=False), limited=False, expected=0.4)

    assert lms.pairs[-1][0] == pytest.approx(0.535 - 0.3 + 0.4, abs=1e-4)
