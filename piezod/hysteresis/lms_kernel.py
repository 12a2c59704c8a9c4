"""The update of the gradient identifiers, compiled: paper eq. (29), also normalised."""

import numpy as np

from piezod.hysteresis.bank import GAINS
from piezod.hysteresis.learner import (
    OFFSET,
    POSITION,
    SCALE,
    Learner,
    advance_operators,
    is_finite,
    keep_weights_invertible,
    limited_error,
    own_prediction,
)
from piezod.hysteresis.memory import FloatArray, IntArray, Memory
from piezod.jit import compiled


@compiled
def _power(memory: Memory, bank: FloatArray, position: float) -> float:
    """Return ‖E - x‖², the squared norm of the regressor."""
    power = 0.0
    for j in range(memory.now.size):
        power += (bank[GAINS, j] * (position - memory.now[j])) ** 2
    return power


@compiled
def _adapt(
    memory: Memory,
    learner: Learner,
    gain: float,
    floor: float,
    sensitivity: float,
    deadband: float,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    """Update the weights with one pair, paper eq. (29); return the error e, paper eq. (30).

    The update is a ← a + 2γ e (E - x) if the floor is 0. With a floor above 0 it is normalised:
    a ← a + μ e (E - x) / (floor + ‖E - x‖²).
    """
    if not is_finite(position):
        return np.nan  # the operators must not see it: their memory would keep it
    bank, weights, scalars = learner.bank, learner.weights, learner.scalars
    seen = advance_operators(memory, learner, deadband, position)
    if floor == 0.0:  # the paper clamps the displacement: its part outside the range has no effect
        scalars[POSITION] = (seen + scalars[OFFSET]) / (1.0 + scalars[SCALE])
    error = drive - own_prediction(memory, learner)
    if learn and is_finite(error):
        rate = 2.0 * gain if floor == 0.0 else gain / (floor + _power(memory, bank, seen))
        # Limiting the error bounds the effect of one wrong pair; the returned error is not limited.
        stride = rate * limited_error(error)
        for j in range(weights.size):  # E - x = g (x - F), paper eq. (29)
            weights[j] += stride * (bank[GAINS, j] * (seen - memory.now[j]))
        keep_weights_invertible(learner, sensitivity * abs(stride))
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
    gain: float,
    floor: float,
    sensitivity: float,
    deadband: float,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    """Adapt to one pair; return the error before the update. Real-time safe."""
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, scalars, slopes, cells)
    return _adapt(memory, learner, gain, floor, sensitivity, deadband, position, drive, learn)


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
    gain: float,
    floor: float,
    sensitivity: float,
    deadband: float,
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
            memory, learner, gain, floor, sensitivity, deadband, position, drive, True
        )
