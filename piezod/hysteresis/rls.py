"""Recursive least squares on the slopes of the inverse model, with drift and a gain that changes.

This is the Kalman filter of slopes that walk at random: each pair weighs as much as it tells anew,
and the covariance P says what is not known. In slope coordinates the regressor u of a displacement
y comes straight from the plays, u_J = r_J E_J - r_{J-1} E_{J-1} with r E^l = y - (1 - r) F^r, and
is far better conditioned than that of the weights:

    drive = Σ s_J u_J - y,   K = P u / (R + u' P u),   s ← s + K e,   P ← P - K u' P + Q.

The slopes of a side keep Σ s c = 1, and so P and Q live on the plane across its cells c. That the
whole range takes another displacement cannot be told by them: the operators see
y = (1 + scale) x - offset. Offset and scale are two more states, with the regressors -1 and x: the
slope is near one.

Where nothing moves nothing is learned at all, and `covariance` bounds P: it cannot wind up.

Source: Ljung, System Identification, 2nd ed., section 11.2 (the Kalman filter interpretation).
"""

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.bank import THRESHOLDS
from piezod.hysteresis.covariance import (
    DECAY,
    GAIN,
    OFFSET_BOUND,
    OFFSET_VARIANCE,
    REGRESSOR,
    SCALE_BOUND,
    SCALE_VARIANCE,
    SLOPE_BOUND,
    SLOPE_VARIANCE,
    checked_walk,
    fill_gain,
    on_planes,
    update_covariance,
)
from piezod.hysteresis.learner import (
    OFFSET,
    OFFSET_LIMIT,
    POSITION,
    SCALE,
    SCALE_LIMIT,
    Learner,
    is_finite,
    limited,
    observe,
    own_prediction,
    taught,
)
from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    RAW,
    SEEN,
    FloatArray,
    IntArray,
    Memory,
)
from piezod.hysteresis.online import OnlineIdentifier
from piezod.hysteresis.slopes import fill_slopes, fill_weights, keep_invertible
from piezod.jit import compiled


@compiled
def _fill_regressor(
    memory: Memory, bank: FloatArray, measured: float, regressor: FloatArray
) -> None:
    """Write u of both sides, then those of offset and scale."""
    position, order = memory.last[RAW], memory.now.size // 2
    place = 0
    for side in range(2):
        before = 0.0
        for j in range(side * order, (side + 1) * order):
            height = position - (1.0 - bank[THRESHOLDS, j]) * memory.now[j]
            regressor[place] = height - before
            before = height
            place += 1
        regressor[place] = position - before
        place += 1
    regressor[place] = -1.0
    regressor[place + 1] = limited(measured, 1.0)  # whatever a pair claims, as in `taught`


@compiled
def _learn(
    memory: Memory,
    learner: Learner,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    variance: float,
    error: float,
) -> None:
    bank, slopes, scalars = learner.bank, learner.slopes, learner.scalars
    _fill_regressor(memory, bank, scalars[POSITION], vectors[REGRESSOR])
    told = variance + fill_gain(covariance, vectors)
    stride, gain = error / told, vectors[GAIN]
    fill_slopes(bank, learner.weights, slopes)
    cells_of_side = slopes.shape[1]
    for side in range(2):
        for j in range(cells_of_side):
            slopes[side, j] += stride * gain[side * cells_of_side + j]
    keep_invertible(slopes, learner.cells)
    fill_weights(bank, slopes, learner.weights)
    offset, scale = 2 * cells_of_side, 2 * cells_of_side + 1
    scalars[OFFSET] = limited(scalars[OFFSET] + stride * gain[offset], OFFSET_LIMIT)
    scalars[SCALE] = limited(scalars[SCALE] + stride * gain[scale], SCALE_LIMIT)
    update_covariance(covariance, walk, vectors, told)


@compiled
def _adapt(
    memory: Memory,
    learner: Learner,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    variance: float,
    deadband: float,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    """Update all states and their covariance with one pair; return the error before."""
    if not is_finite(position):
        return np.nan
    before = memory.last[SEEN]
    observe(memory, learner, deadband, position)
    error = drive - own_prediction(memory, learner)
    if learn and is_finite(error) and memory.last[SEEN] != before:
        _learn(memory, learner, covariance, walk, vectors, variance, taught(error))
    return error


@compiled
def _step(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    weights: FloatArray,
    scalars: FloatArray,
    slopes: FloatArray,
    cells: FloatArray,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    deadband: float,
    variance: float,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, scalars, slopes, cells)
    return _adapt(
        memory, learner, covariance, walk, vectors, variance, deadband, position, drive, learn
    )


@compiled
def _run(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    weights: FloatArray,
    scalars: FloatArray,
    slopes: FloatArray,
    cells: FloatArray,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    deadband: float,
    variance: float,
    positions: FloatArray,
    drives: FloatArray,
    errors: FloatArray,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, scalars, slopes, cells)
    for k in range(errors.size):
        position, drive = positions[k], drives[k]
        errors[k] = _adapt(
            memory, learner, covariance, walk, vectors, variance, deadband, position, drive, True
        )


class RLSIdentifier(OnlineIdentifier):
    """Follows slopes, an offset and a scale, each as fast as the pairs tell and its walk allows.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        weights: (2 M,) weights [a^l, a^r] to start from, of a model that was identified.
        weight_walk: Variance that each slope gains in a learning step, in [0, `SLOPE_BOUND`).
        offset_walk: The same of the offset, in [0, `OFFSET_BOUND`), in units of the range squared.
        scale_walk: The same of the scale, in [0, `SCALE_BOUND`).
        measurement_variance: R, variance of the error that no model explains, above 0.
        deadband: Width of the backlash before the memory, in units of the range; above the noise.
        capacity: Extrema remembered on each side.

    Raises:
        ModelError: If an argument is outside its range.
    """

    def __init__(
        self,
        bank: FloatArray,
        weights: npt.ArrayLike,
        *,
        weight_walk: float = 1e-8,
        offset_walk: float = 3e-9,
        scale_walk: float = 3e-10,
        measurement_variance: float = 1e-6,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        super().__init__(bank, weights, deadband, capacity)
        if not 0.0 < measurement_variance < np.inf:
            message = f"a variance is finite and above 0, got {measurement_variance:g}"
            raise ModelError(message)
        self.measurement_variance = float(measurement_variance)
        """R; may be set in the loop, above 0, for pairs that are worth less or more."""
        checked_walk("weights", weight_walk, SLOPE_BOUND)
        checked_walk("the offset", offset_walk, OFFSET_BOUND)
        checked_walk("the scale", scale_walk, SCALE_BOUND)
        cells = self._learner.cells
        self._start = on_planes(cells, SLOPE_VARIANCE, OFFSET_VARIANCE, SCALE_VARIANCE)
        self._covariance = self._start.copy()
        vectors = np.zeros((3, len(self._start)))
        vectors[DECAY] = np.sqrt(1.0 - weight_walk / SLOPE_BOUND)
        vectors[DECAY, -2] = np.sqrt(1.0 - offset_walk / OFFSET_BOUND)
        vectors[DECAY, -1] = np.sqrt(1.0 - scale_walk / SCALE_BOUND)
        walk = on_planes(cells, weight_walk, offset_walk, scale_walk)
        self._arguments = (
            *self._memory,
            *self._learner,
            self._covariance,
            walk,
            vectors,
            self._deadband,
        )

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, as in `OnlineIdentifier`; may be called in the loop.

        A pair teaches only when it moves the operators; else it tells nothing of the slopes.
        """
        return _step(
            *self._arguments, self.measurement_variance, float(position), float(drive), learn
        )

    def _run(self, positions: FloatArray, drives: FloatArray, errors: FloatArray) -> None:
        _run(*self._arguments, self.measurement_variance, positions, drives, errors)

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Take over weights, an offset and a scale, and trust them as little as at the start.

        Weights that no inverse belongs to are projected onto the nearest that have one.

        Raises:
            ModelError: If they are not 2 M finite weights, a finite offset and a scale within
                `SCALE_LIMIT`.
        """
        super().adopt(weights, offset, scale)
        self._covariance[:] = self._start

    @property
    def covariance(self) -> FloatArray:
        """P of [slopes, offset, scale], shape (2 M + 4, 2 M + 4), symmetric; changes in place."""
        return self._covariance
