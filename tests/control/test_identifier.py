"""Adaptation in the loop: which pairs the algorithm sees."""

import pytest

from piezod.control.drive_history import DriveHistory
from piezod.control.identifier import Identifier
from piezod.devices.interface import Sample
from piezod.hysteresis import AffineRange, Convergence
from tests.control.fakes import MS, PairsOnly

DRIVE_V = AffineRange(0.0, 100.0)
POSITION_UM = AffineRange(-5.0, 5.0)


def identifier(lms: PairsOnly, delay_ns: int = 0, cycles: int = 10) -> Identifier:
    """Return an identifier of a stage whose voltage was k volts at k milliseconds."""
    history = DriveHistory(0.0, entries=256)
    for k in range(cycles):
        history.append(k * MS, float(k))
    return Identifier(lms, DRIVE_V, POSITION_UM, history, delay_ns, Convergence(0.1, window=2))


def test_pair_is_normalised() -> None:
    """Displacement and voltage arrive in units of their ranges."""
    lms = PairsOnly()

    identifier(lms).learn(Sample(8 * MS, 2.5, valid=True))

    assert lms.pairs == [(0.75, 0.08)]


@pytest.mark.parametrize(
    ("delay_ns", "drive_v"), [(0, 8.0), (MS, 7.0), (MS // 4, 7.75), (3 * MS + 1, 5.0), (99 * MS, 0)]
)
def test_sample_is_paired_with_the_voltage_it_answers_to(delay_ns: int, drive_v: float) -> None:
    """What counts is the voltage in force one delay before the sample was taken."""
    lms = PairsOnly()

    identifier(lms, delay_ns).learn(Sample(8 * MS, 0.0, valid=True))

    assert [drive for _, drive in lms.pairs] == pytest.approx([drive_v / 100], abs=1e-7)


def test_age_of_a_sample_counts() -> None:
    """A sample that was taken before the cycle is paired with an earlier voltage."""
    lms = PairsOnly()

    identifier(lms, MS).learn(Sample(8 * MS - MS // 2, 0.0, valid=True))

    assert [drive for _, drive in lms.pairs] == pytest.approx([0.065])


def test_invalid_sample_teaches_nothing() -> None:
    """Neither the weights nor the verdict on convergence move."""
    lms = PairsOnly(errors=[0.0, 0.0, 0.0])
    one = identifier(lms)
    for _ in range(3):
        one.learn(Sample(8 * MS, 0.0, valid=True))

    one.learn(Sample(9 * MS, float("nan"), valid=False))

    assert len(lms.pairs) == 3
    assert one.converged


def test_identifier_converges_and_loses_it_again() -> None:
    """The verdict is up to the last sample: a disturbance takes it back."""
    one = identifier(PairsOnly(errors=[0.5, 0.5, 0.5, 0.9, 0.9]))
    verdicts = []
    for _ in range(5):
        one.learn(Sample(8 * MS, 0.0, valid=True))
        verdicts.append(one.converged)

    assert verdicts == [False, False, True, False, False]


def test_rest_proves_nothing() -> None:
    """However small the differences are, and however long: only moves count."""
    lms = PairsOnly(errors=[0.5] * 6)
    one = identifier(lms)
    lms.at_rest = True
    for _ in range(3):
        one.learn(Sample(8 * MS, 0.0, valid=True))
    assert not one.converged

    lms.at_rest = False
    for _ in range(3):
        one.learn(Sample(8 * MS, 0.0, valid=True))

    assert one.converged


def test_weights_are_those_of_the_algorithm() -> None:
    """They are the same array, so that following them costs no copy."""
    lms = PairsOnly()

    assert identifier(lms).weights is lms.weights
