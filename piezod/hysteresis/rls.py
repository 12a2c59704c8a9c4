"""Recursive least squares on the slopes of the inverse model, with an offset and a scale.

This is the Kalman filter for slopes that change as random walks. Each pair counts by its
information, and the covariance P holds the remaining uncertainty. In slope coordinates the
regressor of an operator input y comes directly from the plays, u_J = r_J E_J - r_{J-1} E_{J-1} with
r E^l = y - (1 - r) F^r (paper eq. (13), corrected). It is far better conditioned than the regressor
of the weights:

    drive = Σ s_J u_J - y,   K = P u / (R + u' P u),   s ← s + K e,   P ← P - K u' P + Q.

The slopes of a side keep Σ s c = 1, so P and Q live in the plane normal to its cells c. Slopes
cannot describe a drift or a change of gain of the whole stage: the operators see y = (1 + scale) x
- offset. Offset and scale are two further states, with the regressors -1 and x, because the slope
is near one.

A pair that does not move the operators teaches nothing, and `covariance` bounds P: it cannot wind
up.

Source: Ljung, System Identification, 2nd ed., section 11.2 (the Kalman filter interpretation).
"""

from typing import Self

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
    constrained_covariance,
    fill_gain,
    update_covariance,
)
from piezod.hysteresis.learner import (
    OFFSET,
    OFFSET_LIMIT,
    POSITION,
    SCALE,
    SCALE_LIMIT,
    Learner,
    advance_operators,
    is_finite,
    limited,
    limited_error,
    own_prediction,
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

WEIGHT_WALK, OFFSET_WALK, SCALE_WALK = 1e-8, 3e-9, 3e-10
"""Variances that each slope, the offset and the scale gain per learning step."""
MEASUREMENT_VARIANCE = 1e-6
"""R: variance of the error that no model explains."""


@compiled
def _fill_regressor(
    memory: Memory, bank: FloatArray, measured: float, regressor: FloatArray
) -> None:
    """Write u of both sides, then the regressors of offset and scale."""
    # r_J E_J = y - (1 - r_J) F_J is the displacement up to threshold J; u_J are its differences,
    # and the last cell takes the rest of y.
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
    regressor[place + 1] = limited(measured, 1.0)  # bounds one wrong pair, as `limited_error`


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
    """Update slopes, offset, scale and covariance by one informative pair."""
    bank, slopes, scalars = learner.bank, learner.slopes, learner.scalars
    _fill_regressor(memory, bank, scalars[POSITION], vectors[REGRESSOR])
    innovation_variance = variance + fill_gain(covariance, vectors)  # R + u' P u
    stride, gain = error / innovation_variance, vectors[GAIN]  # K e is stride times gain
    # The weights are the state that others read; slopes are only the coordinates of the update.
    fill_slopes(bank, learner.weights, slopes)
    cells_of_side = slopes.shape[1]
    for side in range(2):
        for j in range(cells_of_side):
            slopes[side, j] += stride * gain[side * cells_of_side + j]
    keep_invertible(slopes, learner.cells)
    fill_weights(bank, slopes, learner.weights)
    offset, scale = 2 * cells_of_side, 2 * cells_of_side + 1
    # The projection and these limits do not change P: it describes the pairs, not the limits.
    scalars[OFFSET] = limited(scalars[OFFSET] + stride * gain[offset], OFFSET_LIMIT)
    scalars[SCALE] = limited(scalars[SCALE] + stride * gain[scale], SCALE_LIMIT)
    update_covariance(covariance, walk, vectors, innovation_variance)


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
    """Update all states and their covariance with one pair; return the error before the update."""
    if not is_finite(position):
        return np.nan  # the operators must not see it: their memory would keep it
    before = memory.last[SEEN]
    advance_operators(memory, learner, deadband, position)
    error = drive - own_prediction(memory, learner)
    # Without a move the pair repeats known information. Learning it would only let P grow.
    if learn and is_finite(error) and memory.last[SEEN] != before:
        _learn(memory, learner, covariance, walk, vectors, variance, limited_error(error))
    return error


# The fields of the tuples are passed one by one, see decision 3.
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
    """Adapts slopes, offset and scale, each at the rate that its random walk and the pairs allow.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        weights: (2 M,) initial weights [a^l, a^r], of an identified model.
        weight_walk: Variance that each slope gains per learning step, in [0, `SLOPE_BOUND`).
        offset_walk: Variance that the offset gains per learning step, in [0, `OFFSET_BOUND`), in
            units of the range squared.
        scale_walk: Variance that the scale gains per learning step, in [0, `SCALE_BOUND`).
        measurement_variance: R, variance of the error that no model explains, above 0.
        deadband: Width of the backlash before the memory, in units of the range; larger than the
            noise.
        capacity: Extrema stored on each side.

    Raises:
        ModelError: If an argument is outside its range.
    """

    def __init__(
        self,
        bank: FloatArray,
        weights: npt.ArrayLike,
        *,
        weight_walk: float = WEIGHT_WALK,
        offset_walk: float = OFFSET_WALK,
        scale_walk: float = SCALE_WALK,
        measurement_variance: float = MEASUREMENT_VARIANCE,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        super().__init__(bank, weights, deadband, capacity)
        if not 0.0 < measurement_variance < np.inf:
            message = (
                f"a measurement variance must be finite and above 0, got {measurement_variance:g}"
            )
            raise ModelError(message)
        self.measurement_variance = float(measurement_variance)
        """R, above 0; may be set before each step, to give a pair more or less weight."""
        checked_walk("weights", weight_walk, SLOPE_BOUND)
        checked_walk("the offset", offset_walk, OFFSET_BOUND)
        checked_walk("the scale", scale_walk, SCALE_BOUND)
        cells = self._learner.cells
        # Kept for `adopt`, which restarts the covariance.
        self._start = constrained_covariance(cells, SLOPE_VARIANCE, OFFSET_VARIANCE, SCALE_VARIANCE)
        self._covariance = self._start.copy()
        # D of the update: P decays by Q / bound per step. The last two states are offset and scale.
        vectors = np.zeros((3, len(self._start)))
        vectors[DECAY] = np.sqrt(1.0 - weight_walk / SLOPE_BOUND)
        vectors[DECAY, -2] = np.sqrt(1.0 - offset_walk / OFFSET_BOUND)
        vectors[DECAY, -1] = np.sqrt(1.0 - scale_walk / SCALE_BOUND)
        walk = constrained_covariance(cells, weight_walk, offset_walk, scale_walk)
        self._arguments = (
            *self._memory,
            *self._learner,
            self._covariance,
            walk,
            vectors,
            self._deadband,
        )

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, as in `OnlineIdentifier`. Real-time safe.

        The identifier learns from a pair only if it moves the operators: otherwise the pair carries
        no information about the slopes.
        """
        # The variance is not in the tuple, because callers change it between steps.
        return _step(
            *self._arguments, self.measurement_variance, float(position), float(drive), learn
        )

    def _run(self, positions: FloatArray, drives: FloatArray, errors: FloatArray) -> None:
        _run(*self._arguments, self.measurement_variance, positions, drives, errors)

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Replace weights, offset and scale, and restart their covariance.

        Weights without an inverse are projected onto the nearest weights with an inverse.

        Raises:
            ModelError: If they are not 2 M finite weights, a finite offset and a scale within
                `SCALE_LIMIT`.
        """
        super().adopt(weights, offset, scale)
        self._covariance[:] = self._start

    @classmethod
    def paced(
        cls, bank: FloatArray, weights: npt.ArrayLike, pace: float, *, deadband: float
    ) -> Self:
        """Return an identifier that learns at a share of the usual pace, above 0 to 1.

        It is for more frequent pairs: each has less information, and leaves less time for a change.
        """
        return cls(
            bank,
            weights,
            weight_walk=WEIGHT_WALK * pace,
            offset_walk=OFFSET_WALK * pace,
            scale_walk=SCALE_WALK * pace,
            measurement_variance=MEASUREMENT_VARIANCE / pace,
            deadband=deadband,
        )

    @property
    def covariance(self) -> FloatArray:
        """P of [slopes, offset, scale], shape (2 M + 4, 2 M + 4), symmetric; changes in place."""
        return self._covariance
