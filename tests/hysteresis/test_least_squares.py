"""Batch identification."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import (
    InverseMPI,
    even_thresholds,
    graded_thresholds,
    identify_least_squares,
    new_bank,
    parameter_covariance,
    ridge_penalty,
    smallest_slope_of,
    solve_constrained,
    stop_regressors,
    to_slopes,
    to_weights,
)
from piezod.hysteresis.slopes import LEAST_CHORD, LEAST_SLOPE, cells

Array = NDArray[np.float64]
Problem = tuple[Array, Array, Array]
"""A bank, a Gram matrix and a right side."""
THRESHOLDS = even_thresholds(6)
BANK = new_bank(THRESHOLDS, THRESHOLDS)
KNOWN = np.array([0.03, -0.01, 0.02, 0.01, 0.04, 0.02, 0.01, 0.02, -0.02, 0.03, 0.01, 0.05])


def record(noise: float = 0.0) -> tuple[Array, Array]:
    """Return nested loops of displacement, and the drives of a model with known weights."""
    t = np.arange(0, 40, 2e-3)
    positions = 0.5 - 0.5 * np.cos(np.pi * t) * np.cos(0.07 * np.pi * t)
    drives = positions + stop_regressors(BANK, positions) @ KNOWN
    return positions, drives + noise * np.random.default_rng(1).standard_normal(t.size)


def test_known_weights_are_recovered() -> None:
    """Without noise and with hardly any ridge, the fit finds the weights of the record."""
    weights = identify_least_squares(BANK, *record(), ridge=1e-14)

    np.testing.assert_allclose(weights, KNOWN, rtol=0, atol=1e-8)


def test_ridge_of_the_default_costs_little() -> None:
    """The prediction stays accurate to a ten-thousandth of the range."""
    positions, drives = record()
    weights = identify_least_squares(BANK, positions, drives)

    predicted = positions + stop_regressors(BANK, positions) @ weights

    np.testing.assert_allclose(predicted, drives, rtol=0, atol=1e-4)


def test_fitted_weights_are_those_of_an_inverse_model() -> None:
    """Left stops come first: a model built from the two halves predicts the record."""
    positions, drives = record()
    weights = identify_least_squares(BANK, positions, drives, ridge=1e-14)
    inverse = InverseMPI(THRESHOLDS, THRESHOLDS, weights[6:], weights[:6])

    np.testing.assert_allclose(inverse.run(positions), drives, rtol=0, atol=1e-8)


def test_noise_is_averaged_out() -> None:
    """Noise of 1 % leaves a prediction that is ten times better than the record."""
    positions, noisy = record(noise=0.01)
    _, clean = record()
    weights = identify_least_squares(BANK, positions, noisy)

    predicted = positions + stop_regressors(BANK, positions) @ weights

    assert np.sqrt(np.mean((predicted - clean) ** 2)) < 0.001


@pytest.mark.parametrize("seed", range(5))
def test_ridge_keeps_weights_in_bounds_where_the_record_says_little(seed: int) -> None:
    """One noisy partial loop does not determine 38 weights, but none of them grows large."""
    bank = new_bank(even_thresholds(19), even_thresholds(19))
    random = np.random.default_rng(seed)
    t = np.arange(0, 4, 1e-3)
    positions = 0.5 - 0.1 * np.cos(np.pi * t) + 1e-3 * random.standard_normal(t.size)

    weights = identify_least_squares(bank, positions, positions + 0.02)

    assert np.max(np.abs(weights)) < 1


def test_positions_outside_the_range_are_clamped() -> None:
    """Overshoot and noise at the ends do not change the fit."""
    positions, drives = record()
    beyond = np.where(positions > 0.999, 1.2, np.where(positions < 0.001, -0.3, positions))
    clamped = np.clip(beyond, 0, 1)

    weights = identify_least_squares(BANK, beyond, drives)

    assert weights.tolist() == identify_least_squares(BANK, clamped, drives).tolist()


@st.composite
def problems(draw: st.DrawFn, *, extras: int, most: int = 20) -> Problem:
    """Draw programmes whose unconstrained solution may be far from any invertible model."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    order = draw(st.integers(1, most))
    place = draw(st.sampled_from([even_thresholds, graded_thresholds]))
    size = 2 * order + extras
    spread = 10 ** random.uniform(-draw(st.floats(0, 2)), 0, size)
    rows = random.standard_normal((size + 20, size)) * spread
    gram = rows.T @ rows
    gram += ridge_penalty(gram, 1e-6) * np.eye(size)
    distance = 10 ** draw(st.floats(-3, 1))
    right_side = gram @ random.standard_normal(size) * distance
    return new_bank(place(order), place(order)), gram, right_side


def feasible_weights(bank: Array, random: np.random.Generator) -> Array:
    """Return weights of a model whose slopes and chords are at or above the limits of the fit."""
    widths = cells(bank)
    flattest = 1 + LEAST_SLOPE - LEAST_CHORD
    parts = random.random(widths.shape) ** random.choice([1, 20])
    parts /= np.sum(parts * widths, axis=1, keepdims=True)
    knots = np.cumsum(widths, axis=1)
    heights = np.cumsum((flattest + (1 - flattest) * parts) * widths, axis=1)
    lifted = np.maximum(heights, LEAST_CHORD * knots)
    return to_weights(bank, np.diff(lifted, axis=1, prepend=0) / widths)


def slopes_and_chords(bank: Array, weights: Array) -> tuple[Array, Array]:
    """Return all slopes of the major branches, and all their chords from the start."""
    slopes, widths = to_slopes(bank, weights), cells(bank)
    return slopes, np.cumsum(slopes * widths, axis=1) / np.cumsum(widths, axis=1)


def equality_solution(gram: Array, right_side: Array, rows: Array, bounds: Array) -> list[Array]:
    """Return the best point on some constraints, or none if they contradict each other."""
    count = len(rows)
    system = np.block([[gram, rows.T], [rows, np.zeros((count, count))]])
    if count and np.linalg.matrix_rank(rows) < count:  # numpy 2.0 has no rank without rows
        return []
    return [np.linalg.solve(system, np.append(right_side, bounds))[: len(gram)]]


@given(problem=problems(extras=3), seed=st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_no_feasible_point_is_better_than_the_constrained_solution(
    problem: Problem, seed: int
) -> None:
    """The objective does not fall towards any feasible point, so the solution is the minimum."""
    bank, gram, right_side = problem
    random = np.random.default_rng(seed)
    size = len(right_side)
    signed = [size - 3, size - 1]
    solution = solve_constrained(gram, right_side, bank, nonnegative=tuple(signed))
    gradient = gram @ solution - right_side
    scale = np.sqrt(np.diag(gram))

    for _ in range(20):
        other = np.append(feasible_weights(bank, random), random.standard_normal(3))
        other[signed] = np.abs(other[signed]) * random.choice([0, 1], 2)
        towards = other - solution

        assert gradient @ towards >= -1e-6 * np.linalg.norm(right_side / scale) * np.linalg.norm(
            scale * towards
        )


@given(problem=problems(extras=1, most=1))
@settings(deadline=None)
def test_solution_is_the_best_of_all_that_bind_some_constraints(problem: Problem) -> None:
    """With one operator a side, a search over all sets of binding constraints gives the same."""
    bank, gram, right_side = problem
    slope, chord = 1 + LEAST_SLOPE - LEAST_CHORD, LEAST_CHORD
    _, (gain_left, gain_right) = bank  # s_1 = 1 + a g, s_2 = 1 - a; s_1 is a chord too
    rows = np.diag([gain_left, gain_right, 1.0])[[0, 1, 0, 1, 2]]
    rows[2:4] = [[-1, 0, 0], [0, -1, 0]]
    bounds = np.array([max(slope, chord) - 1, max(slope, chord) - 1, slope - 1, slope - 1, 0])
    found = []
    for count in range(4):
        for binding in combinations(range(5), count):
            points = equality_solution(gram, right_side, rows[list(binding)], bounds[list(binding)])
            found += [p for p in points if np.all(rows @ p >= bounds - 1e-9)]

    solution = solve_constrained(gram, right_side, bank, nonnegative=(2,))

    best = min(found, key=lambda p: float(0.5 * p @ gram @ p - right_side @ p))
    np.testing.assert_allclose(solution, best, rtol=0, atol=1e-7)


@given(problem=problems(extras=4))
@settings(deadline=None)
def test_constrained_solution_fulfils_every_constraint(problem: Problem) -> None:
    """Slopes and chords hold up to rounding, existence and signs to the last bit."""
    bank, gram, right_side = problem
    size = len(right_side)

    solution = solve_constrained(gram, right_side, bank, nonnegative=(size - 4, size - 2))

    slopes, chords = slopes_and_chords(bank, solution[: bank.shape[1]])
    assert np.min(slopes) >= 1 + LEAST_SLOPE - LEAST_CHORD - 1e-6
    assert np.min(chords) >= LEAST_CHORD - 1e-6
    assert smallest_slope_of(bank, solution[: bank.shape[1]]) >= LEAST_SLOPE
    assert np.all(solution[[size - 4, size - 2]] >= 0)


@given(problem=problems(extras=2), push=st.floats(1e-3, 1e3))
@settings(deadline=None)
def test_parameter_pushed_below_zero_ends_at_zero(problem: Problem, push: float) -> None:
    """If its sign binds, the other parameters are those of the problem without it."""
    bank, gram, right_side = problem
    last = len(right_side) - 1
    gram[last, :last] = gram[:last, last] = 0.0
    right_side[last] = -push * gram[last, last]

    solution = solve_constrained(gram, right_side, bank, nonnegative=(last,))
    without = solve_constrained(gram[:last, :last], right_side[:last], bank)

    assert solution[last] == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(solution[:last], without, rtol=1e-6, atol=1e-6)


def test_signs_bind_one_by_one() -> None:
    """Of four parameters with a negative optimum, the two with a sign constraint are zero."""
    wanted = np.concatenate((KNOWN, [-1.0, -2.0, -3.0, -4.0]))

    solution = solve_constrained(np.eye(16), wanted, BANK, nonnegative=(12, 14))

    np.testing.assert_allclose(solution, [*KNOWN, 0, -2, 0, -4], rtol=0, atol=1e-12)


def test_solution_is_the_unconstrained_one_where_that_is_feasible() -> None:
    """Constraints that do not bind change nothing."""
    random = np.random.default_rng(5)
    rows = random.standard_normal((50, 12))

    solution = solve_constrained(rows.T @ rows, rows.T @ (rows @ KNOWN), BANK)

    np.testing.assert_allclose(solution, KNOWN, rtol=0, atol=1e-12)


def test_record_of_a_stage_without_an_inverse_gives_a_model_with_one() -> None:
    """A drive that falls while the displacement rises is fitted by an invertible model."""
    positions, _ = record()
    impossible = np.where(KNOWN > 0, 30 * KNOWN, -KNOWN)
    drives = positions + stop_regressors(BANK, positions) @ impossible
    assert smallest_slope_of(BANK, impossible) < 0

    weights = identify_least_squares(BANK, positions, drives)

    assert smallest_slope_of(BANK, weights) >= LEAST_SLOPE


def test_parameters_that_the_record_does_not_determine_are_refused() -> None:
    """The message reports a singular Gram matrix."""
    with pytest.raises(ModelError, match="the record does not determine the parameters"):
        solve_constrained(np.ones((12, 12)), np.ones(12), BANK)
    with pytest.raises(ModelError, match="the record does not determine the parameters"):
        parameter_covariance(np.zeros((2, 2)), 1.0)


def test_covariance_is_that_of_the_fitted_parameters() -> None:
    """Fits of noisy records scatter with this covariance."""
    random = np.random.default_rng(7)
    rows = random.standard_normal((60, 12))
    gram, noise = rows.T @ rows, 1e-3

    fits = [
        solve_constrained(gram, rows.T @ (rows @ KNOWN + noise * random.standard_normal(60)), BANK)
        for _ in range(400)
    ]

    expected = np.sqrt(np.diag(parameter_covariance(gram, noise**2)))
    np.testing.assert_allclose(np.std(fits, axis=0), expected, rtol=0.15)
