"""The paper's identification, step by step against its equations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.hysteresis import (
    Convergence,
    LMSIdentifier,
    even_thresholds,
    new_bank,
    stop_regressors,
)
from tests.hysteresis import oracle
from tests.hysteresis.draw import dense, inputs

Inputs = NDArray[np.floating]
PAPER_BANK = new_bank(even_thresholds(19), even_thresholds(19))


def transcription(
    thresholds: NDArray[np.float64], gain: float, positions: Inputs, drives: Inputs
) -> tuple[list[float], NDArray[np.float64]]:
    """Return the errors and the last weights, by eqs 29 and 30 as they are printed."""
    stops = oracle.stops(list(thresholds), list(thresholds))
    weights = np.zeros(2 * thresholds.size)
    errors = []
    for x, v in zip(positions, drives, strict=True):
        phi = stops(float(x)) - x
        error = v - (x + weights @ phi)
        weights = weights + 2 * gain * error * phi
        errors.append(float(error))
    return errors, weights


def record(seed: int, seconds: float = 40.0) -> tuple[Inputs, Inputs, NDArray[np.float64]]:
    """Return displacements, the drives that known weights make of them, and these weights."""
    random = np.random.default_rng(seed)
    known = random.uniform(0.0, 0.04, 38)
    t = np.arange(0, seconds, 1e-3)
    positions = 0.5 - 0.5 * np.cos(np.pi * t) * np.cos(0.07 * np.pi * t)
    return positions, positions + stop_regressors(PAPER_BANK, positions) @ known, known


@settings(max_examples=30)
@given(
    positions=inputs(least=2, most=30),
    order=st.integers(1, 6),
    gain=st.sampled_from([0.01, 0.1]),
    seed=st.integers(0, 9),
)
def test_identifier_follows_the_printed_equations(
    positions: Inputs, order: int, gain: float, seed: int
) -> None:
    """Errors are those of eq 30 and weights those of eq 29, from zero on."""
    drives = np.random.default_rng(seed).random(positions.size)
    lms = LMSIdentifier(new_bank(even_thresholds(order), even_thresholds(order)), gain=gain)

    errors = lms.run(positions, drives)

    expected, weights = transcription(even_thresholds(order), gain, positions, drives)
    np.testing.assert_allclose(errors, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(lms.weights, weights, rtol=0, atol=1e-12)


def test_steps_are_a_run_to_the_bit() -> None:
    """Pair by pair or over a record is the same arithmetic."""
    positions, drives, _ = record(1, seconds=2)
    stepped, run = (LMSIdentifier(PAPER_BANK, deadband=1e-3) for _ in range(2))

    errors = [stepped.step(x, v) for x, v in zip(positions, drives, strict=True)]

    assert errors == run.run(positions, drives).tolist()
    assert stepped.weights.tolist() == run.weights.tolist()


@given(points=inputs(least=2))
def test_gain_of_the_paper_is_stable(points: NDArray[np.float64]) -> None:
    """With 19 thresholds a side ‖E - x‖² stays below 5.9, so that 2γ ‖E - x‖² < 2 at γ = 0.1."""
    regressors = stop_regressors(PAPER_BANK, dense(points, 10))

    assert np.max(np.sum(regressors**2, axis=1)) < 5.9


def test_identifier_learns_known_weights() -> None:
    """After some periods it predicts the drive to a thousandth of the range."""
    positions, drives, _ = record(2)
    lms = LMSIdentifier(PAPER_BANK)

    errors = lms.run(positions, drives)

    assert np.max(np.abs(drives - positions)) > 0.1
    assert np.max(np.abs(errors[-4000:])) < 1e-3


def test_dwell_does_not_wind_up() -> None:
    """An hour at one point teaches one error only, and leaves the weights in bounds."""
    lms = LMSIdentifier(PAPER_BANK)
    lms.run(np.linspace(0, 0.3, 100), np.linspace(0, 0.4, 100))

    errors = lms.run(np.full(3_600_000, 0.3), np.full(3_600_000, 0.4))

    assert errors[-1] == pytest.approx(0, abs=1e-12)
    assert np.max(np.abs(lms.weights)) < 1


def test_reset_forgets_the_displacement_and_keeps_the_weights() -> None:
    """A new record starts from rest with what was learnt."""
    positions, drives, _ = record(3, seconds=4)
    lms = LMSIdentifier(PAPER_BANK)
    lms.run(positions, drives)
    learnt = lms.weights.copy()

    lms.reset()

    assert lms.weights.tolist() == learnt.tolist()
    assert lms.step(0.0, 0.0) == 0.0


def test_position_that_is_not_a_number_is_no_move() -> None:
    """A measurement that failed neither moves the operators nor spoils the weights."""
    lms, spared = LMSIdentifier(PAPER_BANK), LMSIdentifier(PAPER_BANK)

    for identifier, failed in ((lms, float("nan")), (spared, 0.4)):
        for position in (0.2, 0.4, failed, 0.3):
            identifier.step(position, 0.3)

    assert lms.weights.tolist() == spared.weights.tolist()


def test_position_is_what_the_operators_see() -> None:
    """Behind a dead-band small moves do not show."""
    lms = LMSIdentifier(PAPER_BANK, deadband=0.02)
    seen = []
    for position in (0.5, 0.505, 0.495, 0.52):
        lms.step(position, 0.5)
        seen.append(lms.position)

    assert seen == pytest.approx([0.49, 0.495, 0.495, 0.51])


def test_pairs_given_up_are_counted() -> None:
    """The identifier's memory is bounded too."""
    lms = LMSIdentifier(PAPER_BANK, capacity=4)
    decaying = 0.5 + 0.4 * 0.9 ** np.arange(30) * (-1.0) ** np.arange(30)

    lms.run(decaying, decaying)

    assert lms.merged_pairs > 0


def test_identifier_has_converged_after_a_window_of_small_differences() -> None:
    """Three successive differences below the tolerance, and not one fewer."""
    convergence = Convergence(tolerance=0.1, window=3)
    errors = [0.5, 0.45, 0.40, 0.35, 0.36]

    assert [convergence.update(e) for e in errors] == [False, False, False, True, True]


@pytest.mark.parametrize("disturbance", [0.9, float("nan"), float("inf")])
def test_one_large_difference_starts_the_window_anew(disturbance: float) -> None:
    """One jump of the error, up and down again, costs a whole window."""
    convergence = Convergence(tolerance=0.1, window=2)
    for error in (0.0, 0.0, 0.0):
        settled = convergence.update(error)
    assert settled

    after = [convergence.update(e) for e in (disturbance, 0.0, 0.0, 0.0)]

    assert after == [False, False, False, True]


def test_a_difference_of_the_tolerance_itself_is_not_small() -> None:
    """The criterion is strict, and the first error has nothing to differ from."""
    convergence = Convergence(tolerance=0.25, window=1)

    assert [convergence.update(e) for e in (0.0, 0.25, 0.25)] == [False, False, True]
