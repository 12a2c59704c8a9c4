"""Compiled steps of `surface_rls`: recursive least squares on coefficients and offset."""

import numpy as np

from piezod.hysteresis.covariance import GAIN, REGRESSOR, fill_gain, update_covariance
from piezod.hysteresis.everett_memory import (
    advance_drive,
    displacement,
    displacement_beside,
)
from piezod.hysteresis.learner import OFFSET_LIMIT, is_finite, limited, limited_error
from piezod.hysteresis.memory import SEEN, FloatArray, IntArray, Memory
from piezod.jit import compiled

OFFSET, POSITION, DRIVE, MARGIN, FLOOR = 0, 1, 2, 3, 4
"""Indices of the scalars: offset, last displacement without what is beside the surface, last drive,
a lower bound of the smallest slope of the surface minus `FLOOR`, and the smallest slope that the
surface keeps."""
SMALLEST = 0.025
"""Smallest slope that a learned model keeps. Half of that of an identified one, so that a surface
that was identified at its limit can still learn."""
_ROUNDS = 6  # corrections that are tried after a step out of the condition
_OVERSHOOT = 1.5  # exact corrections of one row after the other approach the condition without end


@compiled
def _least(rows: FloatArray, coefficients: FloatArray) -> tuple[float, int]:
    """Return the smallest bound of a slope, and its row."""
    least, worst = np.inf, 0
    for i in range(rows.shape[0]):
        bound = 0.0
        for j in range(coefficients.size):
            bound += rows[i, j] * coefficients[j]
        if bound < least:
            least, worst = bound, i
    return least, worst


@compiled
def keep_surface_invertible(
    coefficients: FloatArray,
    scalars: FloatArray,
    covariance: FloatArray,
    rows: FloatArray,
    stride: float,
    gain: FloatArray,
) -> None:
    """Correct coefficients that left the condition of existence, or take their step back.

    A correction moves along P a, with the row a of the condition: it changes least what the pairs
    have determined best. The step was `stride` times `gain`; it ends with the corrections in it.
    """
    size = coefficients.size
    for _ in range(_ROUNDS):
        least, worst = _least(rows, coefficients)
        scalars[MARGIN] = least - scalars[FLOOR]
        if least >= scalars[FLOOR]:
            return
        power = 0.0
        for i in range(size):
            for j in range(size):
                power += rows[worst, i] * covariance[i, j] * rows[worst, j]
        if power <= 0.0:
            break
        part = _OVERSHOOT * (scalars[FLOOR] - least) / power
        for i in range(size):
            moved = 0.0
            for j in range(size):
                moved += covariance[i, j] * rows[worst, j]
            coefficients[i] += part * moved
            gain[i] += part * moved / stride  # so that the whole step can be taken back
    least, _ = _least(rows, coefficients)
    scalars[MARGIN] = least - scalars[FLOOR]
    if least < scalars[FLOOR]:
        for i in range(size):
            coefficients[i] -= stride * gain[i]
        scalars[MARGIN] = 0.0


@compiled
def _learn(
    memory: Memory,
    coefficients: FloatArray,
    scalars: FloatArray,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    rows: FloatArray,
    steepest: FloatArray,
    variance: float,
    error: float,
) -> None:
    """Update coefficients, offset and covariance by one informative pair."""
    regressor, gain, size = vectors[REGRESSOR], vectors[GAIN], coefficients.size
    for j in range(size):
        regressor[j] = memory.now[j]
    regressor[size] = 1.0
    innovation_variance = variance + fill_gain(covariance, vectors)
    stride = error / innovation_variance
    moved = 0.0
    for j in range(size):
        coefficients[j] += stride * gain[j]
        moved += abs(stride * gain[j]) * steepest[j]
    scalars[OFFSET] = limited(scalars[OFFSET] + stride * gain[size], OFFSET_LIMIT)
    update_covariance(covariance, walk, vectors, innovation_variance)
    # The condition costs more than the step. It is checked when the slopes may have moved by the
    # whole margin of the last check.
    scalars[MARGIN] -= moved
    if scalars[MARGIN] < 0.0 and stride != 0.0:
        root = np.sqrt(innovation_variance)  # `update_covariance` has divided the gain by it
        keep_surface_invertible(coefficients, scalars, covariance, rows, stride * root, gain)


# The fields of the tuples are passed one by one, see decision 3.
@compiled
def step(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    coefficients: FloatArray,
    scalars: FloatArray,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    rows: FloatArray,
    steepest: FloatArray,
    deadband: float,
    variance: float,
    terms: FloatArray,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    """Adapt to one pair; return the error before the update. Real-time safe."""
    memory = Memory(levels, values, now, last, counts)
    if not is_finite(drive):
        return np.nan
    before = memory.last[SEEN]
    advance_drive(memory, terms, deadband, drive)
    scalars[DRIVE] = drive
    if not is_finite(position):
        return np.nan
    scalars[POSITION] = position - displacement_beside(memory, terms)
    error = scalars[POSITION] - displacement(coefficients, memory.now) - scalars[OFFSET]
    # Without a move the pair repeats known information. Learning it would only let P grow.
    if learn and memory.last[SEEN] != before:
        _learn(
            memory,
            coefficients,
            scalars,
            covariance,
            walk,
            vectors,
            rows,
            steepest,
            variance,
            limited_error(error),
        )
    return -error


@compiled
def predicted_drive(
    now: FloatArray, scalars: FloatArray, coefficients: FloatArray, offset: float
) -> float:
    """Return the drive that another model expects at the last displacement. Real-time safe.

    All slopes are near one, so that the miss of the displacement is that of the drive.
    """
    miss = scalars[POSITION] - offset - displacement(coefficients, now)
    return scalars[DRIVE] + miss
