"""A bank: all operators of a model evaluated together on one memory.

Identification and adaptation use this form. A rising right play stays flat from the minimum of the
loop until it meets the line (v - r) / (1 - r), and it falls along the chord of the loop. A left
play is the mirror image: paper eq. (2) and eq. (5), the latter corrected. Each stop minus x is a
gain times x minus a play, because r E^r + (1 - r) F^l = x and r E^l + (1 - r) F^r = x, which are
paper eq. (12) and eq. (13), corrected. The inverse model, paper eq. (16), becomes

    z = x + Σ a_j (E_j - x) = x + Σ a_j g_j (x - F_j),   g_j = (1 - r_j) / r_j.

This sum stays exact while the weights change. The closed form stores outputs at the extrema, which
a change of the weights would make wrong.
"""

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    MAXIMUM,
    MINIMUM,
    SEEN,
    FloatArray,
    Memory,
    MemoryLoop,
    accept_input,
    backlash,
    clamp,
    commit,
    locate,
    new_memory,
)
from piezod.jit import compiled

THRESHOLDS, GAINS = 0, 1
"""Rows of a bank."""

_MAX_STEPS = 50  # of the search for a displacement; about ten are needed
_SAME_DRIVE = 1e-13  # a smaller difference of drives is rounding


def checked_thresholds(thresholds: npt.ArrayLike) -> FloatArray:
    """Return thresholds as an array of shape (M,), M >= 1.

    Raises:
        ModelError: If they do not increase strictly inside (0, 1).
    """
    array = np.array(thresholds, dtype=np.float64, ndmin=1)
    inside = array.ndim == 1 and array.size > 0 and bool(np.all((array > 0.0) & (array < 1.0)))
    if not inside or bool(np.any(np.diff(array) <= 0.0)):
        message = f"thresholds must increase strictly inside (0, 1), got {array}"
        raise ModelError(message)
    return array


def checked_series(values: npt.ArrayLike) -> FloatArray:
    """Return a time series as a contiguous array of shape (n,), as the kernels need it.

    Raises:
        ModelError: If the values have another number of dimensions.
    """
    # Contiguous, so that every caller uses the same compiled version of a kernel.
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 1:
        message = f"a time series has one dimension, got shape {array.shape}"
        raise ModelError(message)
    return array


def checked_pairs(positions: npt.ArrayLike, drives: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return a record of pairs, paper eq. (26), as arrays of shape (n,) each.

    Raises:
        ModelError: If the shapes differ.
    """
    x, v = checked_series(positions), checked_series(drives)
    if x.shape != v.shape:
        message = f"need as many drives as positions, got shapes {v.shape} and {x.shape}"
        raise ModelError(message)
    return x, v


def checked_deadband(width: float) -> float:
    """Return the width of a dead-band, in units of the range.

    Raises:
        ModelError: If the width is not in [0, 1).
    """
    if not 0.0 <= width < 1.0:
        message = f"the width of a dead-band is from 0 to below 1 of the range, got {width:g}"
        raise ModelError(message)
    return float(width)


def stop_gains(thresholds: FloatArray) -> FloatArray:
    """Return g = (1 - r) / r: E - x = g (x - F), paper eq. (10) and eq. (11), corrected."""
    return (1.0 - thresholds) / thresholds


def new_bank(
    left_stop_thresholds: npt.ArrayLike, right_stop_thresholds: npt.ArrayLike
) -> FloatArray:
    """Return thresholds and gains of M left and M right stops, shape (2, 2 M).

    Left stops come first, because they belong to the right plays. The weights of a bank have the
    same order, [a^l, a^r] of shape (2 M,), and so have the plays in its memory, [F^r, F^l].

    Raises:
        ModelError: If thresholds do not increase strictly inside (0, 1) or the sides differ in
            number.
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
    """Write all plays at a located input into `plays`, shape (2 M,), [F^r, F^l]. Real-time safe.

    Right plays follow paper eq. (2), left plays paper eq. (5), corrected. The chord of the loop is
    κv + λ of paper eq. (3).
    """
    levels, values = memory.levels, memory.values
    # The chord is evaluated as w_m + (w_M - w_m) (v - v_m) / (v_M - v_m), not as κv + λ: in loops
    # of width 1e-9 the latter costs an error of 3e-7.
    top, bottom = loop.maxima - 1, loop.minima - 1
    v_max, v_min = levels[MAXIMUM, top], levels[MINIMUM, bottom]
    order = plays.size // 2
    # Rising: right plays are flat, then follow their line; left plays follow the chord. Falling is
    # the mirror image. The chord starts at the extremum where the move began.
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
    """Advance all plays in `memory.now` by one input; return the input clamped. Real-time safe.

    This is one step of paper eq. (1) and eq. (4) for all operators.
    """
    value = accept_input(memory, value)
    seen = backlash(memory, value, deadband)
    loop = locate(memory, seen)
    evaluate_plays(memory, bank, loop, seen, memory.now)
    commit(memory, loop, seen)
    return value


@compiled
def weighted_sum(plays: FloatArray, bank: FloatArray, weights: FloatArray, value: float) -> float:
    """Return z of paper eq. (16) for plays that were evaluated at this input. Real-time safe."""
    # The sum runs in a fixed order, so that steps and runs agree to the bit.
    total = value
    for j in range(weights.size):
        total += weights[j] * (bank[GAINS, j] * (value - plays[j]))
    return total


@compiled
def drive_at(
    memory: Memory, bank: FloatArray, plays: FloatArray, weights: FloatArray, position: float
) -> float:
    """Return the drive for a displacement, paper eq. (16); the memory does not change."""
    evaluate_plays(memory, bank, locate(memory, position), position, plays)
    return weighted_sum(plays, bank, weights, position)


@compiled
def position_for(
    memory: Memory, bank: FloatArray, plays: FloatArray, weights: FloatArray, drive: float
) -> float:
    """Return the displacement for which the model gives a drive, by the Illinois method.

    The model is monotone, 0 at 0 and 1 at 1, so that the bracket [0, 1] always holds the solution.
    If one end of the bracket stays twice in a row, its miss is halved, so that both ends converge.
    Source: M. Dowell and P. Jarratt, BIT 11 (1971).
    """
    drive = clamp(drive, 0.0)
    low, high = 0.0, 1.0
    low_miss, high_miss = -drive, 1.0 - drive
    middle: float = memory.last[SEEN]
    stayed = 0
    miss = weighted_sum(memory.now, bank, weights, middle) - drive
    for _ in range(_MAX_STEPS):
        if abs(miss) < _SAME_DRIVE:
            break
        if miss < 0.0:
            low, low_miss = middle, miss
            high_miss *= 0.5 if stayed > 0 else 1.0
            stayed = 1
        else:
            high, high_miss = middle, miss
            low_miss *= 0.5 if stayed < 0 else 1.0
            stayed = -1
        middle = high - high_miss * (high - low) / (high_miss - low_miss)
        miss = drive_at(memory, bank, plays, weights, middle) - drive
    return middle
