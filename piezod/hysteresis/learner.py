"""What is learned pair by pair, and the kernels by which every identifier handles it.

A pair is a displacement and the drive that was in force when it was taken. The operators see the
displacement less an offset, by which stages drift, and the weights predict the drive from them.
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

OFFSET, REMAINDER, SPARE = 0, 1, 2
"""Places of `Learner.shift`: the offset, the displacement less what the operators see of it, and by
how much the smallest slope is known to exceed the least."""

_ROUNDING = 1e-9  # more than a million sums of weights lose


class Learner(NamedTuple):
    """What is learned, and room to work on it; nothing is allocated later.

    Attributes:
        bank: (2, 2 M) thresholds and gains of the stops.
        weights: (2 M,) weights [a^l, a^r].
        shift: (3,) `OFFSET`, `REMAINDER` and `SPARE`.
        slopes: (2, M + 1) room for the slopes that the weights make.
        cells: (2, M + 1) widths of the cells.
    """

    bank: FloatArray
    weights: FloatArray
    shift: FloatArray
    slopes: FloatArray
    cells: FloatArray


def new_learner(bank: FloatArray) -> Learner:
    """Return a learner that knows nothing: weights and offset are 0."""
    widths = cells(bank)
    return Learner(bank, np.zeros(bank.shape[1]), np.zeros(3), np.zeros_like(widths), widths)


@compiled
def is_finite(value: float) -> bool:
    """Return whether a value is a number, and not an infinite one."""
    return value - value == 0.0


@compiled
def observe(memory: Memory, learner: Learner, deadband: float, position: float) -> float:
    """Advance all plays by a finite displacement; return the one they see, within [0, 1]."""
    shift = learner.shift
    seen = advance_plays(memory, learner.bank, deadband, position - shift[OFFSET])
    shift[REMAINDER] = position - seen
    return seen


@compiled
def prediction(memory: Memory, learner: Learner, weights: FloatArray, offset: float) -> float:
    """Return the drive that weights and an offset predict for the last displacement.

    What the operators did not see of it, or would have seen with this offset, counts with the slope
    one: so does what lies outside the range.
    """
    within = weighted_sum(memory.now, learner.bank, weights, memory.last[RAW])
    return within + (learner.shift[REMAINDER] - offset)


@compiled
def keep_weights_invertible(learner: Learner, moved: float) -> None:
    """Project the weights where no inverse belongs to them; else they stay, to the bit.

    The condition is looked at when the slopes can have moved by as much as it had to spare last
    time, and not before: that would cost as much as the learning.

    Args:
        learner: Whose weights have changed.
        moved: Bound on what any slope of one side and any of the other have moved by, together.
    """
    shift, slopes = learner.shift, learner.slopes
    shift[SPARE] -= moved
    if shift[SPARE] > 0.0:
        return
    fill_slopes(learner.bank, learner.weights, slopes)
    if keep_invertible(slopes, learner.cells):
        fill_weights(learner.bank, slopes, learner.weights)
    shift[SPARE] = least_slope(slopes, learner.cells) - LEAST_SLOPE - _ROUNDING


@compiled
def taught(error: float) -> float:
    """Return the error to learn from: at most the whole range, whatever a pair claims."""
    return min(max(error, -1.0), 1.0)
