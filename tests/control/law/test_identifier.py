"""Adaptation in the loop: which pairs the algorithm sees."""

import math

import pytest

from piezod.config.gate_reasons import GateReason
from piezod.control.law.identifier import DriveHistory, Identifier
from piezod.devices.interface import Sample
from piezod.hysteresis import AffineRange, Convergence
from tests.control.fakes import MS, FakeGate, PairsOnly

DRIVE_V = AffineRange(0.0, 100.0)
POSITION_UM = AffineRange(-5.0, 5.0)


def identifier(
    lms: PairsOnly, delay_ns: int = 0, cycles: int = 10, gate: FakeGate | None = None
) -> Identifier:
    """Return an identifier of a stage whose voltage was k volts at k milliseconds."""
    history = DriveHistory(0.0, entries=256)
    for k in range(cycles):
        history.append(k * MS, float(k))
    convergence = Convergence(0.1, window=2)
    gate = gate or FakeGate()
    return Identifier(lms, DRIVE_V, POSITION_UM, history, delay_ns, convergence, gate)


def learn(one: Identifier, position_um: float = 0.0, valid: bool = True) -> None:
    """Let an identifier take a sample at 8 ms."""
    one.learn(8 * MS, Sample(8 * MS, position_um, valid), limited=False, expected=0.3)


def test_pair_is_normalised() -> None:
    """Displacement and voltage arrive in units of their ranges."""
    lms = PairsOnly()

    learn(identifier(lms), 2.5)

    assert lms.pairs == [(0.75, 0.08)]


@pytest.mark.parametrize(
    ("delay_ns", "drive_v"), [(0, 8.0), (MS, 7.0), (MS // 4, 7.75), (3 * MS + 1, 5.0), (99 * MS, 0)]
)
def test_sample_is_paired_with_the_voltage_it_answers_to(delay_ns: int, drive_v: float) -> None:
    """What counts is the voltage in force one delay before the sample was taken."""
    lms = PairsOnly()

    learn(identifier(lms, delay_ns))

    assert [drive for _, drive in lms.pairs] == pytest.approx([drive_v / 100], abs=1e-7)


def test_age_of_a_sample_counts() -> None:
    """A sample that was taken before the cycle is paired with an earlier voltage."""
    lms, gate = PairsOnly(), FakeGate()
    sample = Sample(8 * MS - MS // 2, 0.0, valid=True)

    identifier(lms, MS, gate=gate).learn(8 * MS, sample, limited=True, expected=0.3)

    assert [drive for _, drive in lms.pairs] == pytest.approx([0.065])
    assert gate.asked == [(True, MS // 2, True)]


@pytest.mark.parametrize("reason", [GateReason.LIMITED, GateReason.QUIET, GateReason.REPEATED])
def test_sample_that_may_not_teach_goes_on_to_the_memory(reason: GateReason) -> None:
    """The algorithm sees it, and is told not to learn; the verdict on convergence stays."""
    lms, gate = PairsOnly(errors=[0.0] * 3), FakeGate()
    one = identifier(lms, gate=gate)
    for _ in range(3):
        learn(one)

    gate.reason = reason
    learn(one, 3.0)

    assert lms.taught == [True, True, True, False]
    assert lms.pairs[-1][0] == pytest.approx(0.8)
    assert one.converged


@pytest.mark.parametrize(("position_um", "valid"), [(math.nan, False), (4.0, True)])
def test_memory_goes_on_without_samples_that_are_not_accurate(
    position_um: float, valid: bool
) -> None:
    """It sees the displacement that is expected; the verdict on convergence stays."""
    lms, gate = PairsOnly(errors=[0.0] * 3), FakeGate()
    one = identifier(lms, gate=gate)
    for _ in range(3):
        learn(one)

    gate.reason, gate.accurate = GateReason.SPIKE, False
    learn(one, position_um, valid)

    assert lms.pairs[-1] == (0.3, 0.08)
    assert lms.taught == [True, True, True, False]
    assert one.converged


def test_identifier_converges_and_loses_it_again() -> None:
    """The verdict is up to the last sample: a disturbance takes it back."""
    one = identifier(PairsOnly(errors=[0.5, 0.5, 0.5, 0.9, 0.9]))
    verdicts = []
    for _ in range(5):
        learn(one)
        verdicts.append(one.converged)

    assert verdicts == [False, False, True, False, False]


def test_rest_proves_nothing() -> None:
    """However small the differences are, and however long: only moves count."""
    lms = PairsOnly(errors=[0.5] * 6)
    one = identifier(lms)
    lms.at_rest = True
    for _ in range(3):
        learn(one)
    assert not one.converged

    lms.at_rest = False
    for _ in range(3):
        learn(one)

    assert one.converged


def test_weights_are_those_of_the_algorithm() -> None:
    """They are the same array, so that following them costs no copy."""
    lms = PairsOnly()

    assert identifier(lms).weights is lms.weights


@pytest.mark.fault("D6")
def test_an_eased_identifier_learns_from_every_second_sample_that_can_teach() -> None:
    """The others go on to the memory alone."""
    lms = PairsOnly()
    one = identifier(lms)
    one.gain_halved = True
    for _ in range(4):
        learn(one)
    one.gain_halved = False
    for _ in range(2):
        learn(one)

    assert lms.taught == [False, True, False, True, True, True]
