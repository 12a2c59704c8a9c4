"""The paper's identification, step by step against its equations."""

from collections.abc import Iterator

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
from piezod.hysteresis.slopes import LEAST_SLOPE, smallest_slope_of
from tests.hysteresis import oracle
from tests.hysteresis.draw import command, dense, inputs

Inputs = NDArray[np.floating]
PAPER_BANK = new_bank(even_thresholds(19), even_thresholds(19))


def transcription(
    thresholds: NDArray[np.float64], gain: float, positions: Inputs, drives: Inputs
) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """Yield each error and the weights after it, by paper eq. (29) and eq. (30) as printed."""
    stops = oracle.stops(list(thresholds), list(thresholds))
    weights = np.zeros(2 * thresholds.size)
    for x, v in zip(positions, drives, strict=True):
        phi = stops(float(x)) - x
        error = v - (x + weights @ phi)
        weights = weights + 2 * gain * error * phi
        yield float(error), weights


def record(seed: int, seconds: float = 40.0) -> tuple[Inputs, Inputs, NDArray[np.float64]]:
    """Return displacements, the drives of a model with known weights, and these weights."""
    random = np.random.default_rng(seed)
    known = random.uniform(0.0, 0.04, 38)
    positions = command(seconds)
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
    """Errors are those of paper eq. (30) and weights those of eq. (29), while an inverse exists."""
    drives = np.clip(positions + np.random.default_rng(seed).normal(0, 0.1, positions.size), 0, 1)
    bank = new_bank(even_thresholds(order), even_thresholds(order))
    lms = LMSIdentifier(bank, gain=gain)
    expected = transcription(even_thresholds(order), gain, positions, drives)

    for x, v, (error, weights) in zip(positions, drives, expected, strict=True):
        assert lms.step(x, v) == pytest.approx(error, abs=1e-12)
        if smallest_slope_of(bank, weights) < LEAST_SLOPE + 1e-9:
            break
        np.testing.assert_allclose(lms.weights, weights, rtol=0, atol=1e-12)


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


def test_positions_outside_the_range_are_clamped() -> None:
    """Displacements outside [0, 1] count as its ends, as in the paper."""
    lms, clamped = LMSIdentifier(PAPER_BANK), LMSIdentifier(PAPER_BANK)

    errors = lms.run([0.2, -0.1, 0.7, 1.2, 0.9], np.full(5, 0.5))

    assert errors.tolist() == clamped.run([0.2, 0.0, 0.7, 1.0, 0.9], np.full(5, 0.5)).tolist()


def test_position_is_the_input_of_the_operators() -> None:
    """After a dead-band small moves do not change it."""
    lms = LMSIdentifier(PAPER_BANK, deadband=0.02)
    seen = []
    for position in (0.5, 0.505, 0.495, 0.52):
        lms.step(position, 0.5)
        seen.append(lms.position)

    assert seen == pytest.approx([0.49, 0.495, 0.495, 0.51])


def test_identifier_has_converged_after_a_window_of_small_differences() -> None:
    """It takes three successive differences below the tolerance, and not one fewer."""
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
    """The criterion is strict, and the first error gives no difference."""
    convergence = Convergence(tolerance=0.25, window=1)

    assert [convergence.update(e) for e in (0.0, 0.25, 0.25)] == [False, False, True]
