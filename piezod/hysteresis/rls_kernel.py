"""Compiled steps of `rls`: recursive least squares on slopes, offset and scale."""

import numpy as np

from piezod.hysteresis.bank import THRESHOLDS
from piezod.hysteresis.covariance import (
    GAIN,
    REGRESSOR,
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
    RAW,
    SEEN,
    FloatArray,
    IntArray,
    Memory,
)
from piezod.hysteresis.slopes import fill_slopes, fill_weights, keep_invertible
from piezod.jit import compiled


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
def step(
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
    """Adapt to one pair; return the error before the update. Real-time safe."""
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, scalars, slopes, cells)
    return _adapt(
        memory, learner, covariance, walk, vectors, variance, deadband, position, drive, learn
    )


@compiled
def run(
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
    """Adapt to (n,) pairs; fill the errors before each update."""
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, scalars, slopes, cells)
    for k in range(errors.size):
        position, drive = positions[k], drives[k]
        errors[k] = _adapt(
            memory, learner, covariance, walk, vectors, variance, deadband, position, drive, True
        )
