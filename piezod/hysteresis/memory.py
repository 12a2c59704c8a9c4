"""Madelung memory: the past extrema of an input that still influence the output.

All operators of a model see the same input, so one memory serves them all. It replaces the κ and λ
of paper eq. (3). The memory holds two stacks of dominant extrema, maxima and minima; the last entry
of each stack bounds the loop in which the input moves. The operators and the closed form both store
a row of numbers at each extremum, so the same steps serve both:

* `locate` finds the loop of a new input and the extrema that this input deletes;
* the caller evaluates its operators in that loop;
* `commit` makes the new input the last one.

The arrays have a fixed size, so a step never allocates. If a stack is full, the memory removes the
nested pair of extrema with the smallest effect, and counts it.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.jit import compiled

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]

MAXIMUM, MINIMUM = 0, 1
"""Rows of `Memory.levels` and `Memory.values`; indices of the stack sizes in `Memory.counts`."""
RISING, MERGED = 2, 3
"""Further indices in `Memory.counts`: 1 if the last move rose, else 0; number of removed pairs."""
SEEN, RAW, PINNED, CHANGE = 0, 1, 2, 3
"""Indices in `Memory.last`: the last input after the dead-band, and before the dead-band; the state
of `path_relaxation`: the input after its backlash, and h - h_0."""

# Depths seen: 5 for noise, 10 for random inputs, 25 for a decaying one. What a smaller capacity
# costs is measured in tests/hysteresis/test_capacity.py.
DEFAULT_CAPACITY = 32


class Memory(NamedTuple):
    """State of one memory; a step changes these arrays in place and allocates nothing."""

    #: (2, capacity + 1) inputs at the extrema, outermost first; the last column is spare.
    levels: FloatArray
    values: FloatArray  #: (2, capacity + 1, width) values that the operators had at each extremum.
    now: FloatArray  #: (width,) values that the operators have at the last input.
    #: (4,) the last input after the dead-band and before it, and the state of a term that relaxes
    #: along the path.
    last: FloatArray
    counts: (
        IntArray  #: (4,) number of maxima, number of minima, direction, number of removed pairs.
    )


class MemoryLoop(NamedTuple):
    """Loop in which an input lies: direction of the move, and the sizes of both stacks there."""

    rising: bool
    maxima: int
    minima: int


def new_memory(width: int, capacity: int = DEFAULT_CAPACITY) -> Memory:
    """Return a relaxed memory: minimum (0, 0), maximum (1, 1), input 0, rising.

    Args:
        width: Number of values stored at each extremum; they are 0 at the minimum, 1 at the
            maximum.
        capacity: Extrema stored on each side, the outermost included; at least 4.

    Raises:
        ModelError: If the capacity is below 4.
    """
    if capacity < 4:
        message = f"a memory needs a capacity of at least 4 extrema on each side, got {capacity}"
        raise ModelError(message)
    memory = Memory(
        levels=np.zeros((2, capacity + 1)),
        values=np.zeros((2, capacity + 1, width)),
        now=np.zeros(width),
        last=np.zeros(4),
        counts=np.zeros(4, dtype=np.int64),
    )
    relax(memory)
    return memory


def relax(memory: Memory) -> None:
    """Return a memory to its relaxed state and clear its count of removed pairs."""
    for array in memory:
        array[...] = 0
    memory.levels[MAXIMUM, 0] = 1.0
    memory.values[MAXIMUM, 0, :] = 1.0
    memory.counts[:] = (1, 1, 1, 0)  # the outermost pair, rising, nothing removed


@compiled
def relax_within(memory: Memory) -> None:
    """Do the same as `relax`, within a kernel."""
    levels, values, now, last, counts = memory
    for side in range(levels.shape[0]):
        outermost = 1.0 if side == MAXIMUM else 0.0
        for place in range(levels.shape[1]):
            levels[side, place] = outermost if place == 0 else 0.0
            for j in range(values.shape[2]):
                values[side, place, j] = outermost if place == 0 else 0.0
    for j in range(now.size):
        now[j] = 0.0
    for j in range(last.size):
        last[j] = 0.0
    for j in range(3):
        counts[j] = 1
    counts[3] = 0


def copy_memory(memory: Memory) -> Memory:
    """Return an independent copy."""
    levels, values, now, last, counts = memory
    return Memory(levels.copy(), values.copy(), now.copy(), last.copy(), counts.copy())


def assign_memory(target: Memory, source: Memory) -> None:
    """Copy a state into another memory.

    Raises:
        ModelError: If the two memories have different shapes.
    """
    if target.values.shape != source.values.shape:
        message = "cannot restore a state that a model of another kind or capacity saved"
        raise ModelError(message)
    for to, value in zip(target, source, strict=True):
        to[...] = value


def depth(memory: Memory) -> int:
    """Return the number of stored extrema, without the two outermost."""
    return int(memory.counts[MAXIMUM] + memory.counts[MINIMUM] - 2)


@compiled
def clamp(value: float, fallback: float) -> float:
    """Return the value clamped to [0, 1], or the fallback if the value is NaN. Real-time safe."""
    if value >= 1.0:
        return 1.0
    if value >= 0.0:
        return value
    if value < 0.0:
        return 0.0
    return fallback  # only NaN fails all three comparisons


@compiled
def accept_input(memory: Memory, value: float) -> float:
    """Store and return the next input, clamped to [0, 1]; NaN repeats the last input."""
    memory.last[RAW] = clamp(value, memory.last[RAW])
    return memory.last[RAW]


@compiled
def backlash(memory: Memory, value: float, width: float) -> float:
    """Return the input after a dead-band of this width, so that noise makes no extrema.

    The dead-band is a backlash: the result follows the input at a distance of half the width.
    """
    half = 0.5 * width
    return min(max(memory.last[SEEN], value - half), value + half)


@compiled
def _write_extremum(memory: Memory, side: int, place: int) -> None:
    """Write the last input and the operator values there into one place of a stack."""
    memory.levels[side, place] = memory.last[SEEN]
    for j in range(memory.now.size):
        memory.values[side, place, j] = memory.now[j]


@compiled
def locate(memory: Memory, value: float) -> MemoryLoop:
    """Return the loop of a new input; the stored extrema do not change. Real-time safe.

    At a reversal the last input becomes an extremum. It is written to the first free place, which
    counts only after `commit`. Madelung's deletion comes before the evaluation, and an input equal
    to an extremum deletes it.
    """
    levels, counts = memory.levels, memory.counts
    last = memory.last[SEEN]
    maxima, minima = counts[MAXIMUM], counts[MINIMUM]
    rising = counts[RISING] == 1
    if value > last:
        if not rising:  # reversal: the last input was a minimum
            _write_extremum(memory, MINIMUM, minima)
            minima += 1
        # Passing a maximum closes the loop inside it: that maximum and the minimum below it go
        # together. The outermost pair (0, 0), (1, 1) always stays.
        while maxima > 1 and value >= levels[MAXIMUM, maxima - 1]:
            maxima -= 1
            minima -= 1
        rising = True
    elif value < last:
        if rising:  # reversal: the last input was a maximum
            _write_extremum(memory, MAXIMUM, maxima)
            maxima += 1
        while minima > 1 and value <= levels[MINIMUM, minima - 1]:
            minima -= 1
            maxima -= 1
        rising = False
    return MemoryLoop(rising, maxima, minima)


@compiled
def commit(memory: Memory, loop: MemoryLoop, value: float) -> bool:
    """Make the located input the last one, after the caller has evaluated it into `now`.

    Returns:
        Whether a stack was full, so that a pair of extrema was removed.
    """
    counts = memory.counts
    counts[MAXIMUM] = loop.maxima
    counts[MINIMUM] = loop.minima
    counts[RISING] = 1 if loop.rising else 0
    memory.last[SEEN] = value
    # The spare last column holds the extremum that overfilled the stack until the pair is removed.
    full = max(loop.maxima, loop.minima) == memory.levels.shape[1]
    if full:
        _merge_pair(memory)
    return full


@compiled
def _merge_pair(memory: Memory) -> None:
    """Remove the pair of neighbouring extrema whose loss changes the memory least.

    From the outside in, the extrema are maximum 1, minimum 1, maximum 2, and so on. Removing two
    neighbours cuts a rectangle off the staircase in the Preisach plane, between these two and the
    extrema around them. The pair with the smallest longer side goes, so that the remaining extrema
    stay evenly spaced. The innermost loop, in which the input moves, stays: the output does not
    jump.
    """
    levels, counts = memory.levels, memory.counts
    # All pairs of neighbours except the outermost extrema and the innermost loop.
    smallest, at_maximum, at_minimum = np.inf, 0, 0
    for i in range(1, counts[MINIMUM] - 1):
        drop = levels[MAXIMUM, i] - levels[MAXIMUM, i + 1]
        side = max(drop, levels[MINIMUM, i] - levels[MINIMUM, i - 1])  # maximum i, minimum i
        if side < smallest:
            smallest, at_maximum, at_minimum = side, i, i
        side = max(drop, levels[MINIMUM, i + 1] - levels[MINIMUM, i])  # minimum i, maximum i + 1
        if side < smallest:
            smallest, at_maximum, at_minimum = side, i + 1, i
    _remove_extremum(memory, MAXIMUM, at_maximum)
    _remove_extremum(memory, MINIMUM, at_minimum)
    counts[MERGED] += 1


@compiled
def _remove_extremum(memory: Memory, side: int, index: int) -> None:
    """Remove one extremum and close the gap in its stack."""
    count = memory.counts[side]
    for i in range(index, count - 1):
        memory.levels[side, i] = memory.levels[side, i + 1]
        for j in range(memory.now.size):
            memory.values[side, i, j] = memory.values[side, i + 1, j]
    memory.counts[side] = count - 1
