"""All operators of a model at once, on one memory: what identification and adaptation run on.

Two facts carry this module. A right play that rises is flat from the loop's minimum until it meets
the line (v - r) / (1 - r), and it falls along the chord of the loop; a left play mirrors that
(eq 2, eq 5 corrected). And by `r E^r + (1 - r) F^l = x`, `r E^l + (1 - r) F^r = x` (eqs 12, 13
corrected) each stop is a gain times (x minus a play), so that the inverse model is

    z = x + Σ a_j (E_j - x) = x + Σ a_j g_j (x - F_j),   g_j = (1 - r_j) / r_j   (eq 16).

While weights change, this sum stays exact; the closed form keeps outputs that would grow stale.
"""

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    MAXIMUM,
    MINIMUM,
    FloatArray,
    Memory,
    MemoryLoop,
    backlash,
    commit,
    locate,
    new_memory,
    take,
)
from piezod.jit import compiled

THRESHOLDS, GAINS = 0, 1
"""Rows of a bank."""


def checked_thresholds(thresholds: npt.ArrayLike) -> FloatArray:
    """Return thresholds as an array of shape (M,), M >= 1.

    Raises:
        ModelError: If they are not strictly increasing inside (0, 1).
    """
    array = np.array(thresholds, dtype=np.float64, ndmin=1)
    inside = array.ndim == 1 and array.size > 0 and bool(np.all((array > 0.0) & (array < 1.0)))
    if not inside or bool(np.any(np.diff(array) <= 0.0)):
        message = f"thresholds must increase strictly inside (0, 1), got {array}"
        raise ModelError(message)
    return array


def checked_series(values: npt.ArrayLike) -> FloatArray:
    """Return values over time as an array of shape (n,), ready for a kernel.

    Raises:
        ModelError: If they are of another shape.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 1:
        message = f"values over time have one dimension, got shape {array.shape}"
        raise ModelError(message)
    return array


def checked_deadband(width: float) -> float:
    """Return the width of a dead-band.

    Raises:
        ModelError: If it is not from 0 to below 1.
    """
    if not 0.0 <= width < 1.0:
        message = f"a dead-band is from 0 to below 1 of the range, got {width:g}"
        raise ModelError(message)
    return float(width)


def stop_gains(thresholds: FloatArray) -> FloatArray:
    """Return (1 - r) / r, by which x minus a play becomes a stop minus x."""
    return (1.0 - thresholds) / thresholds


def new_bank(
    left_stop_thresholds: npt.ArrayLike, right_stop_thresholds: npt.ArrayLike
) -> FloatArray:
    """Return thresholds and gains of M left and M right stops, shape (2, 2 M).

    Left stops come first: they go with the right plays. Weights of a bank are ordered alike,
    [a^l, a^r] of shape (2 M,), and so are the plays that its memory keeps, [F^r, F^l].

    Raises:
        ModelError: If thresholds do not increase inside (0, 1) or the sides differ in number.
    """
    left = checked_thresholds(left_stop_thresholds)
    right = checked_thresholds(right_stop_thresholds)
    if left.size != right.size:
        message = f"a bank has as many left as right stops, got {left.size} and {right.size}"
        raise ModelError(message)
    thresholds = np.concatenate((left, right))
    return np.stack((thresholds, stop_gains(thresholds)))


def new_bank_memory(bank: FloatArray, capacity: int = DEFAULT_CAPACITY) -> Memory:
    """Return a relaxed memory for the plays of a bank."""
    return new_memory(bank.shape[1], capacity)


@compiled
def evaluate_plays(
    memory: Memory, bank: FloatArray, loop: MemoryLoop, value: float, plays: FloatArray
) -> None:
    """Write all plays at an input that was located into `plays`, shape (2 M,)."""
    levels, values = memory.levels, memory.values
    top, bottom = loop.maxima - 1, loop.minima - 1
    v_max, v_min = levels[MAXIMUM, top], levels[MINIMUM, bottom]
    order = plays.size // 2
    if loop.rising:
        part = (value - v_min) / (v_max - v_min)
        for j in range(order):
            r = bank[THRESHOLDS, j]
            plays[j] = max((value - r) / (1.0 - r), values[MINIMUM, bottom, j])
        for j in range(order, plays.size):
            at_min = values[MINIMUM, bottom, j]
            plays[j] = at_min + (values[MAXIMUM, top, j] - at_min) * part
    else:
        part = (v_max - value) / (v_max - v_min)
        for j in range(order):
            at_max = values[MAXIMUM, top, j]
            plays[j] = at_max - (at_max - values[MINIMUM, bottom, j]) * part
        for j in range(order, plays.size):
            plays[j] = min(value / (1.0 - bank[THRESHOLDS, j]), values[MAXIMUM, top, j])


@compiled
def advance_plays(memory: Memory, bank: FloatArray, deadband: float, value: float) -> float:
    """Advance all plays by one input, into `memory.now`; return the input clamped to [0, 1]."""
    value = take(memory, value)
    seen = backlash(memory, value, deadband)
    loop = locate(memory, seen)
    evaluate_plays(memory, bank, loop, seen, memory.now)
    commit(memory, loop, seen)
    return value


@compiled
def weighted_sum(plays: FloatArray, bank: FloatArray, weights: FloatArray, value: float) -> float:
    """Return z of eq 16 for plays that were evaluated at this input."""
    total = value
    for j in range(weights.size):
        total += weights[j] * (bank[GAINS, j] * (value - plays[j]))
    return total
