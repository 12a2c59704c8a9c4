"""Recursive least squares: its recursion, its convergence, and its bounded covariance."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import RLSIdentifier, even_thresholds, new_bank, stop_regressors
from piezod.hysteresis.covariance import (
    OFFSET_BOUND,
    OFFSET_VARIANCE,
    SCALE_BOUND,
    SCALE_VARIANCE,
    SLOPE_BOUND,
    SLOPE_VARIANCE,
)
from piezod.hysteresis.learner import OFFSET_LIMIT, SCALE_LIMIT
from piezod.hysteresis.slopes import LEAST_SLOPE, cells, smallest_slope_of, to_slopes, to_weights
from tests.hysteresis import oracle
from tests.hysteresis.draw import command, inputs

Array = NDArray[np.float64]
THRESHOLDS = even_thresholds(19)
BANK = new_bank(THRESHOLDS, THRESHOLDS)
SMALL = new_bank([0.1, 0.4, 0.7], [0.2, 0.5, 0.9])
KNOWN = np.linspace(0.04, 0.0, 38)
SPOILED = [math.nan, math.inf, -math.inf]


def drives_for(positions: Array, weights: Array = KNOWN) -> Array:
    """Return the drives that a known model predicts."""
    return positions + stop_regressors(BANK, positions) @ weights


def everything(rls: RLSIdentifier) -> list[object]:
    """Return the learned model and its covariance."""
    return [rls.weights.tolist(), rls.offset, rls.scale, rls.covariance.tolist()]


def diagonal(bank: Array, slope: float, offset: float, scale: float) -> Array:
    """Return one number for each state, shape (N,)."""
    return np.array([slope] * (bank.shape[1] + 2) + [offset, scale])


def planes(bank: Array) -> Array:
    """Return the projection onto the constraint Σ s c = const of both sides, shape (N, N)."""
    widths = cells(bank)
    count = widths.shape[1]
    onto = np.eye(2 * count + 2)
    for side, c in enumerate(widths):
        block = slice(side * count, (side + 1) * count)
        onto[block, block] -= np.outer(c, c) / (c @ c)
    return onto


class SlowRLS:
    """The textbook Kalman filter, with plain matrices and the operators of `oracle`."""

    def __init__(self, bank: Array, walk: float, variance: float) -> None:
        order = bank.shape[1] // 2
        self.r = bank[0].reshape(2, order)
        self.stops = oracle.stops(list(self.r[0]), list(self.r[1]))
        self.variance = variance
        start = diagonal(bank, SLOPE_VARIANCE, OFFSET_VARIANCE, SCALE_VARIANCE)
        bound = diagonal(bank, SLOPE_BOUND, OFFSET_BOUND, SCALE_BOUND)
        self.p = planes(bank) * start
        self.q = planes(bank) * walk
        self.d = np.diag(np.sqrt(1.0 - walk / bound))
        self.state = diagonal(bank, 1.0, 0.0, 0.0)
        self.seen = 0.0

    def step(self, position: float, drive: float) -> float:
        """Process one pair; return the error before the update."""
        operator_input = (1.0 + self.state[-1]) * position - self.state[-2]
        y = min(max(operator_input, 0.0), 1.0)
        heights = self.stops(y).reshape(2, -1) * self.r
        u = np.append(np.diff(heights, prepend=0.0, append=y).ravel(), [-1.0, position])
        error = float(drive - (self.state[:-2] @ u[:-2] - y + (operator_input - y)))
        if y != self.seen:
            gain = self.p @ u / (self.variance + u @ self.p @ u)
            self.state = self.state + gain * error
            self.p = self.d @ (self.p - np.outer(gain, u @ self.p)) @ self.d + self.q
        self.seen = y
        return error


@settings(max_examples=50)
@given(
    positions=inputs(least=2, most=30),
    walk=st.sampled_from([0.0, 1e-8, 1e-5]),
    variance=st.sampled_from([1e-6, 1e-2]),
    seed=st.integers(0, 9),
)
def test_identifier_is_the_kalman_filter(
    positions: Array, walk: float, variance: float, seed: int
) -> None:
    """Errors, states and covariance are those of plain matrices, while an inverse exists.

    Inputs are rounded, because tiny differences of the offset decide whether a move of 1e-9
    reverses.
    """
    positions = np.round(positions, 6)
    drives = positions + 1e-3 * np.random.default_rng(seed).standard_normal(positions.size)
    slow = SlowRLS(SMALL, walk, variance)
    rls = RLSIdentifier(
        SMALL,
        np.zeros(6),
        weight_walk=walk,
        offset_walk=walk,
        scale_walk=walk,
        measurement_variance=variance,
    )

    for position, drive in zip(positions, drives, strict=True):
        assert rls.step(position, drive) == pytest.approx(slow.step(position, drive), abs=1e-9)
        slopes = slow.state[:-2].reshape(2, -1)
        if smallest_slope_of(SMALL, to_weights(SMALL, slopes)) < LEAST_SLOPE + 1e-9:
            break
        np.testing.assert_allclose(to_slopes(SMALL, rls.weights), slopes, rtol=0, atol=1e-9)
        np.testing.assert_allclose(rls.covariance, slow.p, rtol=0, atol=1e-12)
        assert [rls.offset, rls.scale] == pytest.approx(slow.state[-2:], abs=1e-9)


def test_without_walk_it_is_the_batch_solution() -> None:
    """All pairs count equally: the weights are those of least squares with a prior."""
    positions = command(20.0)
    drives = drives_for(positions)
    rls = RLSIdentifier(BANK, np.zeros(38), weight_walk=0.0, offset_walk=0.0, scale_walk=0.0)
    rls.covariance[-2:, -2:] = 0.0  # offset and scale are known to be 0

    rls.run(positions, drives)

    prior = SLOPE_VARIANCE * planes(BANK)[:-2, :-2]
    basis = np.linalg.svd(prior)[0][:, :38]  # of the slopes that keep Σ s c = 1
    to_weight = np.array([to_weights(BANK, one.reshape(2, -1)) for one in basis.T]).T
    regressors = stop_regressors(BANK, positions) @ to_weight
    normal = regressors.T @ regressors / 1e-6 + np.eye(38) / SLOPE_VARIANCE
    batch = to_weight @ np.linalg.solve(normal, regressors.T @ (drives - positions) / 1e-6)
    np.testing.assert_allclose(rls.weights, batch, rtol=0, atol=1e-8)


def test_known_model_is_learned() -> None:
    """From zero weights, drives are predicted to 2e-3 and an offset found to 2e-3 in 40 s."""
    positions = command(40.0)
    rls = RLSIdentifier(BANK, np.zeros(38))

    errors = rls.run(positions + 0.01, drives_for(positions))

    assert rls.offset == pytest.approx(0.01, abs=2e-3)
    assert np.max(np.abs(errors[-4000:])) < 2e-3


def test_drift_is_followed() -> None:
    """An offset that drifts by 5 % of the range in a minute causes an error of at most 2e-3."""
    positions = command(60.0)
    rls = RLSIdentifier(BANK, KNOWN)

    errors = rls.run(positions + np.linspace(0.0, 0.05, positions.size), drives_for(positions))

    assert rls.offset == pytest.approx(0.05, abs=2e-3)
    assert np.max(np.abs(errors)) < 2e-3


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.0, 0.3), (0.35, 0.65), (0.7, 1.0)])
def test_change_of_gain_and_hysteresis_is_learned(low: float, high: float) -> None:
    """One cycle after a gain of +10 % and a hysteresis of +20 % drives are predicted to 4e-3.

    In a part of the range the scale cannot be distinguished from the slopes there.
    """
    seen = low + (high - low) * command(14.0, beat=0.0)
    drives = np.where(np.arange(seen.size) < 4000, drives_for(seen), drives_for(seen, 1.2 * KNOWN))
    positions = np.where(np.arange(seen.size) < 4000, seen, 1.1 * seen)
    rls = RLSIdentifier(BANK, KNOWN)

    errors = rls.run(positions, drives)

    assert np.max(np.abs(errors[:4000])) < 1e-9
    assert np.max(np.abs(errors[6000:])) < 4e-3
    if high - low == 1.0:
        assert rls.scale == pytest.approx(1.0 / 1.1 - 1.0, abs=5e-3)
        assert rls.offset == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("gain", "scale"), [(0.5, SCALE_LIMIT), (2.0, -SCALE_LIMIT)])
def test_scale_is_bounded(gain: float, scale: float) -> None:
    """An impossible gain leaves the scale at its limit and a model that has an inverse."""
    positions = command(20.0)
    rls = RLSIdentifier(BANK, KNOWN)

    rls.run(gain * positions, drives_for(positions))

    assert rls.scale == pytest.approx(scale, abs=2e-2)
    assert abs(rls.scale) <= SCALE_LIMIT
    assert abs(rls.offset) <= OFFSET_LIMIT
    assert smallest_slope_of(BANK, rls.weights) >= LEAST_SLOPE - 1e-12


def test_offset_and_scale_do_not_run_away_if_they_are_indistinguishable() -> None:
    """Ten minutes around one drifted displacement leave offset and scale small.

    The first full swing afterwards, without the drift, shows no error above 3 %.
    """
    swing = command(4.0)
    held = 0.7 + np.random.default_rng(1).normal(0.0, 1e-3, 600_000)
    drives = drives_for(np.concatenate((held, swing)))
    rls = RLSIdentifier(BANK, KNOWN)

    errors = rls.run(held + 0.02, drives[: held.size])
    apart = rls.offset, rls.scale
    after = rls.run(swing, drives[held.size :])

    assert np.max(np.abs(errors[1000:])) < 2e-3
    assert np.max(np.abs(apart)) < 0.03
    assert np.max(np.abs(after)) < 0.03


def test_tiny_amplitude_does_not_wind_up() -> None:
    """After ten minutes at 1 % amplitude the first full swing shows no error above 1 %."""
    dwell, swing = command(600.0, 0.005), command(4.0)
    positions = np.concatenate((dwell, swing))
    noise = np.random.default_rng(1).normal(0.0, 2e-4, positions.size)
    rls = RLSIdentifier(BANK, KNOWN, deadband=1e-3)

    errors = rls.run(positions + noise, drives_for(positions))

    assert np.max(np.abs(errors[dwell.size :])) < 0.01
    assert np.max(np.diag(rls.covariance)) <= SLOPE_BOUND


def test_no_variance_exceeds_its_bound() -> None:
    """The bounds hold even for walks close to the bound and pairs with hardly any information."""
    rls = RLSIdentifier(
        BANK,
        KNOWN,
        weight_walk=0.99 * SLOPE_BOUND,
        offset_walk=0.99 * OFFSET_BOUND,
        scale_walk=0.99 * SCALE_BOUND,
    )
    rls.measurement_variance = 1e6

    rls.run(command(2.0), command(2.0))

    variances = np.diag(rls.covariance)
    assert np.max(variances[:-2]) <= SLOPE_BOUND
    assert 0.9 * OFFSET_BOUND < variances[-2] <= OFFSET_BOUND
    assert 0.9 * SCALE_BOUND < variances[-1] <= SCALE_BOUND


@pytest.mark.parametrize("rest_s", [300, pytest.param(3600, marks=pytest.mark.stress)])
@pytest.mark.parametrize("noise", [0.0, 2e-4])
def test_long_rest_teaches_nothing(noise: float, rest_s: int) -> None:
    """Model and covariance stay to the bit, with noise inside the dead-band too."""
    rls = RLSIdentifier(BANK, KNOWN, deadband=1e-2)
    rls.run(np.linspace(0.0, 0.3, 100), np.linspace(0.0, 0.4, 100))
    rls.run([0.302, 0.298], [0.4, 0.4])
    learned = everything(rls)

    rest = 0.3 + noise * np.random.default_rng(1).uniform(-1, 1, 1000 * rest_s)
    rls.run(rest, np.full(rest.size, 0.4))

    assert everything(rls) == learned


def test_pairs_of_larger_variance_teach_less() -> None:
    """The measurement variance can be set before each pair."""
    sure, doubtful = RLSIdentifier(BANK, KNOWN), RLSIdentifier(BANK, KNOWN)
    doubtful.measurement_variance = 1e-2

    for rls in (sure, doubtful):
        rls.run([0.3, 0.6, 0.4], [0.3, 0.6, 0.4])

    moved = [float(np.max(np.abs(rls.weights - KNOWN))) for rls in (sure, doubtful)]
    assert 0.0 < 10 * moved[1] < moved[0]


@pytest.mark.parametrize("absurd", [1e300, -1e300, 5.0])
def test_absurd_pairs_leave_the_model_in_bounds(absurd: float) -> None:
    """Repeated displacements or drives of any size leave the model invertible and bounded."""
    rls = RLSIdentifier(BANK, KNOWN)
    for k in range(2000):
        rls.step(absurd if k % 2 else 0.5, 0.5)
        rls.step(0.3, absurd)

    assert np.all(np.isfinite(rls.weights))
    assert abs(rls.offset) <= OFFSET_LIMIT
    assert abs(rls.scale) <= SCALE_LIMIT
    assert smallest_slope_of(BANK, rls.weights) >= LEAST_SLOPE - 1e-12


def test_adopting_a_model_restarts_its_confidence() -> None:
    """The covariance is the initial one again."""
    rls = RLSIdentifier(BANK, KNOWN)
    start = rls.covariance.copy()
    rls.run(command(2.0), command(2.0))
    assert rls.covariance.tolist() != start.tolist()

    rls.adopt(0.5 * KNOWN, 0.02, -0.1)

    assert everything(rls) == [(0.5 * KNOWN).tolist(), 0.02, -0.1, start.tolist()]


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: RLSIdentifier(BANK, KNOWN[1:]), "need 38 finite weights"),
        (lambda: RLSIdentifier(BANK, np.full(38, np.nan)), "need 38 finite weights"),
        (lambda: RLSIdentifier(BANK, KNOWN, weight_walk=-1e-9), "walk of weights must be from 0"),
        (lambda: RLSIdentifier(BANK, KNOWN, weight_walk=SLOPE_BOUND), "below its bound 0.001"),
        (
            lambda: RLSIdentifier(BANK, KNOWN, offset_walk=math.nan),
            "walk of the offset must be from 0",
        ),
        (
            lambda: RLSIdentifier(BANK, KNOWN, scale_walk=SCALE_BOUND),
            "walk of the scale must be from 0",
        ),
        (lambda: RLSIdentifier(BANK, KNOWN, measurement_variance=0.0), "finite and above 0"),
        (lambda: RLSIdentifier(BANK, KNOWN, measurement_variance=math.inf), "finite and above 0"),
        (lambda: RLSIdentifier(BANK, KNOWN, deadband=1.0), "dead-band is from 0 to below 1"),
    ],
)
def test_arguments_outside_their_range_are_refused(call: Callable[[], object], text: str) -> None:
    """The message states the rule."""
    with pytest.raises(ModelError, match=text):
        call()
