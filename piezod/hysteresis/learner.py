"""State of an adaptive identifier, and the kernels that all identifiers share.

A pair is a displacement x and the drive that was in force when x was sampled. A stage drifts and
its gain changes. The operators therefore see y = (1 + scale) x - offset, and the weights predict
the drive from y.
"""

from typing import Final, NamedTuple

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

OFFSET: Final = 0
SCALE: Final = 1
POSITION: Final = 2
SLOPE_MARGIN: Final = 3
"""Indices in `Learner.scalars`: offset, scale, last displacement, and a lower bound of the smallest
slope minus `LEAST_SLOPE`."""

OFFSET_LIMIT, SCALE_LIMIT = 1.0, 0.3
"""Largest magnitudes: no drift exceeds the range, and a sound stage changes its gain by less."""

_ROUNDING = 1e-9  # exceeds the rounding error that a million updates of the weights add up to


class Learner(NamedTuple):
    """Learned parameters and work space; nothing is allocated later."""

    bank: FloatArray  #: (2, 2 M) thresholds and gains of the stops.
    weights: FloatArray  #: (2 M,) weights [a^l, a^r].
    scalars: FloatArray  #: (4,) `OFFSET`, `SCALE`, `POSITION` and `SLOPE_MARGIN`.
    slopes: FloatArray  #: (2, M + 1) work space for the slopes of the weights.
    cells: FloatArray  #: (2, M + 1) widths of the cells.


def new_learner(bank: FloatArray) -> Learner:
    """Return a learner that knows nothing: weights, offset and scale are 0."""
    widths = cells(bank)
    return Learner(bank, np.zeros(bank.shape[1]), np.zeros(4), np.zeros_like(widths), widths)


@compiled
def is_finite(value: float) -> bool:
    """Return whether a value is neither NaN nor infinite."""
    return value - value == 0.0  # NaN and inf - inf are not equal to 0


@compiled
def advance_operators(memory: Memory, learner: Learner, deadband: float, position: float) -> float:
    """Advance all plays by a finite displacement; return the operator input y, clamped."""
    scalars = learner.scalars
    scalars[POSITION] = position
    operator_input = (1.0 + scalars[SCALE]) * position - scalars[OFFSET]
    return advance_plays(memory, learner.bank, deadband, operator_input)


@compiled
def keep_weights_invertible(learner: Learner, moved: float) -> None:
    """Project the weights if their model has no inverse; otherwise they stay the same to the bit.

    The condition costs as much as a learning step. It is checked only when the slopes may have
    moved by the whole margin of the last check.

    Args:
        learner: Learner whose weights have changed.
        moved: Upper bound of the change of a slope of one side plus that of a slope of the other
            side.
    """
    scalars, slopes = learner.scalars, learner.slopes
    scalars[SLOPE_MARGIN] -= moved
    if scalars[SLOPE_MARGIN] > 0.0:
        return  # even in the worst case the condition still holds
    fill_slopes(learner.bank, learner.weights, slopes)
    if keep_invertible(slopes, learner.cells):
        fill_weights(learner.bank, slopes, learner.weights)
    scalars[SLOPE_MARGIN] = least_slope(slopes, learner.cells) - LEAST_SLOPE - _ROUNDING


@compiled
def limited(value: float, limit: float) -> float:
    """Return the value clamped to [-limit, limit]."""
    return min(max(value, -limit), limit)


@compiled
def limited_error(error: float) -> float:
    """Return the error to learn from, clamped to the whole range, so that no pair counts more."""
    return limited(error, 1.0)


# Single arrays, because it is called from Python: see decision 3.
@compiled
def predicted_drive(  # noqa: D417 - arguments are described in groups
    now: FloatArray,
    last: FloatArray,
    bank: FloatArray,
    scalars: FloatArray,
    weights: FloatArray,
    offset: float,
    scale: float,
) -> float:
    """Return the drive that a model predicts for the last displacement: z of paper eq. (30).

    Outside the range, and for a change of offset or scale since the operators advanced, the model
    is extended with the slope one.

    Args:
        now, last: Arrays of a `Memory`.
        bank, scalars: Arrays of a `Learner`.
        weights: (2 M,) weights of the model.
        offset, scale: Offset and scale of the model.
    """
    within = weighted_sum(now, bank, weights, last[RAW])
    # last[RAW] is the clamped input that the operators got; the difference counts with slope one.
    operator_input = (1.0 + scale) * scalars[POSITION] - offset
    return within + (operator_input - last[RAW])


@compiled
def own_prediction(memory: Memory, learner: Learner) -> float:
    """Return the drive that the learned model predicts for the last displacement."""
    scalars = learner.scalars
    return predicted_drive(
        memory.now,
        memory.last,
        learner.bank,
        scalars,
        learner.weights,
        scalars[OFFSET],
        scalars[SCALE],
    )
