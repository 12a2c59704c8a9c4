"""What is learned pair by pair, and the kernels by which every identifier handles it.

A pair is a displacement x and the drive that was in force when it was taken. Stages drift and
change their gain: the operators see y = (1 + scale) x - offset, and the weights predict the drive
from them.
"""

from typing import NamedTuple

import numpy as np

from piezod.hysteresis.bank import advance_plays, weighted_sum
from piezod.hysteresis.memory import RAW, FloatArray, Memory
from piezod.hysteresis.slopes import (
    LEAST_SLOPE,
    cells,
    fill_slopes,
    fill_weights,
    keep_invertible,
    least_slope,
)
from piezod.jit import compiled

OFFSET, SCALE, POSITION, SPARE = 0, 1, 2, 3
"""Places of `Learner.scalars`: offset and scale, the last displacement, and by how much the
smallest slope is known to exceed the least."""

OFFSET_LIMIT, SCALE_LIMIT = 1.0, 0.3
"""Largest magnitudes: no drift exceeds the range, and no sound stage changes its gain by more."""

_ROUNDING = 1e-9  # more than a million sums of weights lose


class Learner(NamedTuple):
    """What is learned, and room to work on it; nothing is allocated later.

    Attributes:
        bank: (2, 2 M) thresholds and gains of the stops.
        weights: (2 M,) weights [a^l, a^r].
        scalars: (4,) `OFFSET`, `SCALE`, `POSITION` and `SPARE`.
        slopes: (2, M + 1) room for the slopes that the weights make.
        cells: (2, M + 1) widths of the cells.
    """

    bank: FloatArray
    weights: FloatArray
    scalars: FloatArray
    slopes: FloatArray
    cells: FloatArray


def new_learner(bank: FloatArray) -> Learner:
    """Return a learner that knows nothing: weights, offset and scale are 0."""
    widths = cells(bank)
    return Learner(bank, np.zeros(bank.shape[1]), np.zeros(4), np.zeros_like(widths), widths)


@compiled
def is_finite(value: float) -> bool:
    """Return whether a value is a number, and not an infinite one."""
    return value - value == 0.0


@compiled
def observe(memory: Memory, learner: Learner, deadband: float, position: float) -> float:
    """Advance all plays by a finite displacement; return the one they see, within [0, 1]."""
    scalars = learner.scalars
    scalars[POSITION] = position
    shown = (1.0 + scalars[SCALE]) * position - scalars[OFFSET]
    return advance_plays(memory, learner.bank, deadband, shown)


@compiled
def prediction(
    memory: Memory, learner: Learner, weights: FloatArray, offset: float, scale: float
) -> float:
    """Return the drive that weights, an offset and a scale predict for the last displacement.

    What the operators did not see of it, or would have seen with these, counts with the slope one:
    so does what lies outside the range.
    """
    within = weighted_sum(memory.now, learner.bank, weights, memory.last[RAW])
    shown = (1.0 + scale) * learner.scalars[POSITION] - offset
    return within + (shown - memory.last[RAW])


@compiled
def own_prediction(memory: Memory, learner: Learner) -> float:
    """Return the drive that what was learned predicts for the last displacement."""
    scalars = learner.scalars
    return prediction(memory, learner, learner.weights, scalars[OFFSET], scalars[SCALE])


@compiled
def keep_weights_invertible(learner: Learner, moved: float) -> None:
    """Project the weights where no inverse belongs to them; else they stay, to the bit.

    The condition is looked at when the slopes can have moved by as much as it had to spare last
    time, and not before: that would cost as much as the learning.

    Args:
        learner: Whose weights have changed.
        moved: Bound on what any slope of one side and any of the other have moved by, together.
    """
    scalars, slopes = learner.scalars, learner.slopes
    scalars[SPARE] -= moved
    if scalars[SPARE] > 0.0:
        return
    fill_slopes(learner.bank, learner.weights, slopes)
    if keep_invertible(slopes, learner.cells):
        fill_weights(learner.bank, slopes, learner.weights)
    scalars[SPARE] = least_slope(slopes, learner.cells) - LEAST_SLOPE - _ROUNDING


@compiled
def limited(value: float, limit: float) -> float:
    """Return a value of a magnitude up to the limit."""
    return min(max(value, -limit), limit)


@compiled
def taught(error: float) -> float:
    """Return the error to learn from: at most the whole range, whatever a pair claims."""
    return limited(error, 1.0)
