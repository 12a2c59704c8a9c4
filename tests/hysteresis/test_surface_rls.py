"""Recursive least squares on a surface: its recursion, its tracking, and its bounds."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.errors import ModelError
from piezod.hysteresis import SurfaceForm, SurfaceIdentifier
from piezod.hysteresis.covariance import (
    MEASUREMENT_VARIANCE,
    OFFSET_BOUND,
    OFFSET_VARIANCE,
    OFFSET_WALK,
)
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.everett_bounds import least_surface_slope, slope_rows
from piezod.hysteresis.learner import OFFSET_LIMIT
from piezod.hysteresis.path_relaxation import PathRelaxation
from piezod.hysteresis.surface_rls import (
    GAIN_VARIANCE,
    GAIN_WALK,
    SHAPE_BOUND,
    SHAPE_VARIANCE,
    SHAPE_WALK,
)
from piezod.hysteresis.surface_rls_kernel import FLOOR, SMALLEST, keep_surface_invertible
from tests.hysteresis.surfaces import DRIVES, Floats, all_pairs, drawn, invertible_with

FORM = SurfaceForm()
KNOWN = drawn(3)
NONSENSE = st.one_of(
    st.floats(-0.5, 1.5, width=32),
    st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300, 7.0, -7.0]),
)
PAIRS = st.lists(st.tuples(NONSENSE, NONSENSE), min_size=1, max_size=60)
"""Displacements and drives of no stage."""


def swings(seconds: float) -> Floats:
    """Return drives at 1 kHz, loops of many sizes within [0, 1]."""
    t_s = np.arange(0.0, seconds, 1e-3)
    swing = 0.5 + 0.45 * np.cos(0.37 * t_s)
    return 0.5 - 0.5 * swing * np.cos(2.0 * np.pi * t_s)


def everything(rls: SurfaceIdentifier) -> list[object]:
    """Return the learned model and its covariance."""
    return [rls.weights.tolist(), rls.offset, rls.covariance.tolist()]


class SlowFilter:
    """The textbook Kalman filter, with plain matrices and regressors from all pairs of extrema."""

    def __init__(self, weights: Floats, pace: float) -> None:
        self.state = np.append(weights, 0.0)
        self.p, self.q = np.zeros((2, SIZE + 1, SIZE + 1))
        along = np.outer(weights, weights)
        self.p[:SIZE, :SIZE] = SHAPE_VARIANCE * np.eye(SIZE) + GAIN_VARIANCE * along
        self.q[:SIZE, :SIZE] = pace * (SHAPE_WALK * np.eye(SIZE) + GAIN_WALK * along)
        self.p[-1, -1], self.q[-1, -1] = OFFSET_VARIANCE, pace * OFFSET_WALK
        decay = np.full(SIZE + 1, 1.0 - pace * SHAPE_WALK / SHAPE_BOUND)
        decay[-1] = 1.0 - pace * OFFSET_WALK / OFFSET_BOUND
        self.d, self.variance = np.diag(np.sqrt(decay)), MEASUREMENT_VARIANCE / pace
        self.past = [0.0]

    def step(self, position: float, drive: float) -> float:
        """Process one pair; return the error of the drive before the update."""
        new = drive != self.past[-1]
        self.past.append(drive)
        basis = np.array([all_pairs(unit, self.past) for unit in np.eye(SIZE)])
        u = np.append(basis, 1.0)
        innovation = float(position - u @ self.state)
        if new:
            gain = self.p @ u / (self.variance + u @ self.p @ u)
            self.state = self.state + gain * innovation
            left = self.p - np.outer(gain, u @ self.p)
            self.p = self.d @ left @ self.d + self.q
        return -innovation


@settings(max_examples=25)
@given(drives=DRIVES, seed=st.integers(0, 20), pace=st.sampled_from([1.0, 0.1]))
def test_identifier_is_the_kalman_filter(drives: list[float], seed: int, pace: float) -> None:
    """Errors, coefficients, offset and covariance are those of plain matrices."""
    weights = drawn(seed)
    rls, slow = SurfaceIdentifier(weights, pace=pace), SlowFilter(weights, pace)
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(len(drives))
    positions = FORM.positions_at(drawn(seed + 1), np.array(drives)) + noise

    for position, drive in zip(positions.tolist(), drives, strict=True):
        assert rls.step(position, drive) == pytest.approx(slow.step(position, drive), abs=1e-10)
        if least_surface_slope(slow.state[:SIZE]) < SMALLEST + 1e-9:
            break
        np.testing.assert_allclose(rls.weights, slow.state[:SIZE], rtol=0, atol=1e-10)
        np.testing.assert_allclose(rls.covariance, slow.p, rtol=0, atol=1e-12)
        assert rls.offset == pytest.approx(slow.state[SIZE], abs=1e-10)


def test_surface_is_learned_from_a_wrong_start() -> None:
    """From a straight line the error decays, and the learned surface predicts other loops."""
    drives, others = swings(60.0), 0.3 + 0.3 * np.sin(np.arange(5000) / 170)
    rls = SurfaceIdentifier(FORM.straight_line())

    positions = FORM.positions_at(KNOWN, drives)
    errors = np.abs(rls.run(positions, drives))

    assert np.max(np.abs(positions - drives)) > 0.05
    assert np.max(errors[-2000:]) < 1e-3
    expected = FORM.positions_at(KNOWN, others)
    assert FORM.positions_at(rls.weights.copy(), others) + rls.offset == pytest.approx(
        expected, abs=5e-3
    )


def test_stage_with_a_path_is_learned() -> None:
    """What relaxes along the path is no error of a model with it, and the surface is learned."""
    path = PathRelaxation(-0.3, 2.0, 0.1)
    form = SurfaceForm(path=path)
    drives, weights = swings(60.0), invertible_with(path, KNOWN)
    rls = SurfaceIdentifier(form.straight_line(), form)

    errors = np.abs(rls.run(form.positions_at(weights, drives), drives))

    assert np.max(errors) > 5e-3
    assert np.max(errors[-2000:]) < 5e-4


def test_drift_of_the_offset_is_tracked() -> None:
    """A drift of 5 % of the range in a minute is found as offset, and no shape is unlearned."""
    drives = swings(60.0)
    drift = np.linspace(0.0, 0.05, drives.size)
    rls = SurfaceIdentifier(KNOWN)

    errors = rls.run(FORM.positions_at(KNOWN, drives) + drift, drives)

    assert np.max(np.abs(errors)) < 2e-3
    assert rls.offset == pytest.approx(0.05, abs=3e-3)
    assert rls.weights == pytest.approx(KNOWN, abs=5e-3)


def test_change_of_gain_is_tracked() -> None:
    """A gain that rises by 10 % in a minute is found as a common factor of the coefficients."""
    drives = swings(60.0)
    gain = np.linspace(1.0, 1.1, drives.size)
    rls = SurfaceIdentifier(KNOWN)

    errors = rls.run(gain * FORM.positions_at(KNOWN, drives), drives)

    assert np.max(np.abs(errors)) < 3e-3
    assert (rls.weights @ KNOWN) / (KNOWN @ KNOWN) == pytest.approx(1.1, abs=0.01)
    assert rls.scale == 0.0


def test_error_is_the_drive_minus_the_expected_drive() -> None:
    """A stage that is too low needs more drive than was applied: the error is negative."""
    rls = SurfaceIdentifier(FORM.straight_line())

    assert rls.step(0.5, 0.6, learn=False) == pytest.approx(0.1, abs=1e-15)
    assert rls.step(0.7, 0.6, learn=False) == pytest.approx(-0.1, abs=1e-15)


@given(drives=DRIVES, miss=st.floats(-0.1, 0.1))
def test_prediction_with_the_own_model_is_the_drive_without_the_error(
    drives: list[float], miss: float
) -> None:
    """`predict` gives what `step` compares the drive with."""
    rls = SurfaceIdentifier(KNOWN)
    for drive in drives[:-1]:
        rls.step(math.nan, drive)
    position = float(FORM.positions_at(KNOWN, np.array(drives))[-1]) + miss

    error = rls.step(position, drives[-1], learn=False)

    predicted = rls.predict(rls.weights, rls.offset, rls.scale)
    assert drives[-1] - predicted == pytest.approx(error, abs=1e-14)
    assert error == pytest.approx(-miss, abs=1e-12)
    assert rls.predict(rls.weights, rls.offset - 0.01, 0.0) == pytest.approx(predicted + 0.01)


@pytest.mark.fault("D3")
@given(
    pairs=PAIRS,
    seed=st.integers(0, 9),
    pace=st.sampled_from([1.0, 0.01]),
    path=st.sampled_from([None, PathRelaxation(-0.3, 2.0, 0.1)]),
)
def test_any_pairs_leave_a_surface_that_can_be_inverted(
    pairs: list[tuple[float, float]], seed: int, pace: float, path: PathRelaxation | None
) -> None:
    """After nonsense every proven slope is at least the limit, and all numbers are finite."""
    form = SurfaceForm(path=path)
    weights = invertible_with(path, drawn(seed)) if path else drawn(seed)
    rls = SurfaceIdentifier(weights, form, pace=pace)

    for position, drive in pairs:
        error = rls.step(position, drive)
        assert math.isfinite(error) or not (math.isfinite(position) and math.isfinite(drive))

    assert form.smallest_slope(rls.weights) >= SMALLEST - 1e-12
    assert np.all(np.isfinite(rls.covariance))
    assert abs(rls.offset) <= OFFSET_LIMIT
    assert rls.covariance.tolist() == rls.covariance.T.tolist()


def test_pairs_against_the_condition_stop_at_its_limit() -> None:
    """A stage that stands still while it is driven flattens the surface to the limit only."""
    rls, drives = SurfaceIdentifier(KNOWN), swings(20.0)
    least = []

    for drive in drives.tolist():
        rls.step(0.5, drive)
        least.append(least_surface_slope(rls.weights))

    assert min(least) >= SMALLEST - 1e-12
    assert min(least) == pytest.approx(SMALLEST, abs=5e-3)


@pytest.mark.parametrize("variance", [0.0, 1e-5], ids=["taken back", "corrected"])
def test_step_out_of_the_condition_is_corrected_or_taken_back(variance: float) -> None:
    """With a covariance it is corrected to the limit; if nothing may move, it is taken back."""
    gain, stride, scalars = np.zeros(SIZE + 1), 0.1, np.zeros(5)
    scalars[FLOOR] = SMALLEST
    gain[4] = 1.0  # slopes of narrow loops become smaller
    while least_surface_slope(KNOWN + stride * gain[:SIZE]) >= SMALLEST:
        stride += 0.1
    coefficients = KNOWN + stride * gain[:SIZE]
    covariance = variance * np.eye(SIZE + 1)

    keep_surface_invertible(coefficients, scalars, covariance, slope_rows(), stride, gain)

    assert least_surface_slope(coefficients) >= SMALLEST - 1e-12
    if variance:
        assert least_surface_slope(coefficients) == pytest.approx(SMALLEST, abs=5e-3)
        assert coefficients == pytest.approx(KNOWN + stride * gain[:SIZE])
    else:
        assert coefficients == pytest.approx(KNOWN, abs=1e-15)


@pytest.mark.parametrize("noise", [0.0, 2e-4])
def test_dwell_teaches_nothing(noise: float) -> None:
    """Within the dead-band model and covariance stay to the bit, for any displacement."""
    rls = SurfaceIdentifier(KNOWN, deadband=1e-2)
    drives = np.linspace(0.0, 0.3, 100)
    rls.run(FORM.positions_at(KNOWN, drives), drives)
    rls.run([0.3, 0.3], [0.302, 0.298])
    learned = everything(rls)

    rng = np.random.default_rng(1)
    rls.run(rng.uniform(0.0, 1.0, 20_000), 0.3 + noise * rng.uniform(-1, 1, 20_000))

    assert everything(rls) == learned


def test_tiny_amplitude_does_not_wind_up() -> None:
    """After five minutes at 0.5 % amplitude the first full swing shows no error above 1 %."""
    dwell = 0.5 + 0.005 * np.sin(2.0 * np.pi * np.arange(300_000) / 1000)
    drives = np.concatenate((dwell, swings(4.0)))
    noise = np.random.default_rng(1).normal(0.0, 2e-4, drives.size)
    rls = SurfaceIdentifier(KNOWN)

    errors = rls.run(FORM.positions_at(KNOWN, drives) + noise, drives)

    assert np.max(np.abs(errors[dwell.size :])) < 0.01
    # The part along the gain has no decay of its own, so it adds to the bound of the shape.
    variances = np.diag(rls.covariance)
    assert np.max(variances[:SIZE]) <= SHAPE_BOUND * (1.0 + GAIN_WALK / SHAPE_WALK)
    assert variances[SIZE] <= OFFSET_BOUND


def test_full_memory_is_counted_and_stays_close() -> None:
    """A memory that merges pairs still predicts; the drives are known to be nested."""
    decays = 0.5 + 0.4 * 0.97 ** np.arange(200) * (-1.0) ** np.arange(200)
    rls = SurfaceIdentifier(KNOWN, capacity=16)

    errors = rls.run(FORM.positions_at(KNOWN, decays), decays)

    assert rls.merged_pairs > 0
    assert np.max(np.abs(errors)) < 0.05


def test_adopting_a_model_restarts_its_confidence() -> None:
    """Coefficients and offset are the given ones, and the covariance is the initial one."""
    rls = SurfaceIdentifier(KNOWN)
    start = rls.covariance.copy()
    rls.run(swings(2.0), swings(2.0))
    weights = rls.weights
    assert rls.covariance.tolist() != start.tolist()

    rls.adopt(KNOWN, 0.02)

    assert rls.weights is weights
    assert everything(rls) == [KNOWN.tolist(), 0.02, start.tolist()]


def test_reset_forgets_the_past_and_keeps_the_model() -> None:
    """After a reset the drive counts as coming from rest."""
    rls = SurfaceIdentifier(KNOWN)
    rls.run(swings(1.0), swings(1.0))
    model = everything(rls)

    rls.reset()
    fresh = SurfaceIdentifier(rls.weights.copy())

    assert everything(rls) == model
    offset = rls.offset
    for drive in (0.3, 0.2, 0.7):
        error = rls.step(0.4, drive, learn=False)
        assert error == pytest.approx(fresh.step(0.4, drive, learn=False) + offset, abs=1e-14)
    assert rls.position == 0.7


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: SurfaceIdentifier(KNOWN[1:]), "need 24 finite weights"),
        (lambda: SurfaceIdentifier(np.full(SIZE, np.nan)), "need 24 finite weights"),
        (lambda: SurfaceIdentifier(-KNOWN), "the surface is not monotone: .* identify again"),
        (lambda: SurfaceIdentifier(KNOWN).adopt(KNOWN, math.nan), "a finite offset and no scale"),
        (lambda: SurfaceIdentifier(KNOWN).adopt(KNOWN, 0.0, 0.1), "a finite offset and no scale"),
        (lambda: SurfaceIdentifier(KNOWN, deadband=1.0), "dead-band is from 0 to below 1"),
        (lambda: SurfaceIdentifier(KNOWN, pace=0.0), "pace is above 0, got 0"),
        (lambda: SurfaceIdentifier(KNOWN, pace=math.nan), "pace is above 0, got nan"),
        (lambda: SurfaceIdentifier(KNOWN).run([0.1], [0.1, 0.2]), "as many drives as positions"),
    ],
)
def test_arguments_outside_their_range_are_refused(call: Callable[[], object], text: str) -> None:
    """The message states the rule."""
    with pytest.raises(ModelError, match=text):
        call()


def test_refused_model_changes_nothing() -> None:
    """A model that cannot be adopted leaves the present one."""
    rls = SurfaceIdentifier(KNOWN)
    rls.run(swings(1.0), swings(1.0))
    learned = everything(rls)

    with pytest.raises(ModelError):
        rls.adopt(-KNOWN, 0.3)

    assert everything(rls) == learned
