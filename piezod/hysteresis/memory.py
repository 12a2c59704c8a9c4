"""Madelung's memory: which past extrema of an input still matter.

All operators of a model see one input, so one memory serves them all (κ and λ of the paper's eq 3).
It holds two stacks of dominant extrema, maxima and minima; the pair on top bounds the loop in which
the input moves. Both the operators and the closed form keep what they need at each extremum as a
row of numbers, so the same three kernels serve both:

* `locate` finds the loop in which a new input lies and what it wipes out, and changes nothing;
* the caller evaluates its operators in that loop;
* `commit` makes it so.

The arrays have a fixed size. A full stack gives up the nested pair of extrema that matters least,
and counts it.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.jit import compiled

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]

MAXIMUM, MINIMUM = 0, 1
"""Rows of `Memory.levels` and `Memory.values`, and places of their depths in `Memory.counts`."""
RISING, MERGED = 2, 3
"""Further places in `Memory.counts`: the direction of the last move (1 or 0), pairs given up."""
SEEN, RAW = 0, 1
"""Places in `Memory.last`: the last input behind the dead-band, and before it."""

DEFAULT_CAPACITY = 32


class Memory(NamedTuple):
    """The state of one memory: all that a step touches; nothing is allocated later.

    Attributes:
        levels: (2, capacity + 1) inputs at the extrema, outermost first; the last place is spare.
        values: (2, capacity + 1, width) what the operators held at each extremum.
        now: (width,) what the operators hold at the last input.
        last: (2,) the last input, behind the dead-band and before it.
        counts: (4,) number of maxima, number of minima, rising, merged pairs.
    """

    levels: FloatArray
    values: FloatArray
    now: FloatArray
    last: FloatArray
    counts: IntArray


class MemoryLoop(NamedTuple):
    """Where an input lies: direction of the move and the depth of both stacks then."""

    rising: bool
    maxima: int
    minima: int


def new_memory(width: int, capacity: int = DEFAULT_CAPACITY) -> Memory:
    """Return a relaxed memory: minimum (0, 0), maximum (1, 1), input 0, rising.

    Args:
        width: numbers kept at each extremum; 0 at the minimum, 1 at the maximum.
        capacity: extrema kept on each side, the outermost included; at least 4.

    Raises:
        ModelError: If the capacity is too small to give up a pair of extrema.
    """
    if capacity < 4:
        message = f"a memory keeps at least 4 extrema on each side, got a capacity of {capacity}"
        raise ModelError(message)
    memory = Memory(
        levels=np.zeros((2, capacity + 1)),
        values=np.zeros((2, capacity + 1, width)),
        now=np.zeros(width),
        last=np.zeros(2),
        counts=np.zeros(4, dtype=np.int64),
    )
    relax(memory)
    return memory


def relax(memory: Memory) -> None:
    """Put a memory back into its relaxed state and clear its count of merged pairs."""
    for array in memory:
        array[...] = 0
    memory.levels[MAXIMUM, 0] = 1.0
    memory.values[MAXIMUM, 0, :] = 1.0
    memory.counts[:] = (1, 1, 1, 0)


def copy_memory(memory: Memory) -> Memory:
    """Return an independent copy."""
    levels, values, now, last, counts = memory
    return Memory(levels.copy(), values.copy(), now.copy(), last.copy(), counts.copy())


def assign_memory(target: Memory, source: Memory) -> None:
    """Copy a state into another memory.

    Raises:
        ModelError: If it is the state of a memory of another shape.
    """
    if target.values.shape != source.values.shape:
        message = "a state of another capacity, or of another kind of model, cannot be restored"
        raise ModelError(message)
    for to, value in zip(target, source, strict=True):
        to[...] = value


def depth(memory: Memory) -> int:
    """Return the number of extrema remembered beside the two outermost."""
    return int(memory.counts[MAXIMUM] + memory.counts[MINIMUM] - 2)


@compiled
def clamp(value: float, otherwise: float) -> float:
    """Return a value within [0, 1]; what is not a number becomes `otherwise`."""
    if value >= 1.0:
        return 1.0
    if value >= 0.0:
        return value
    if value < 0.0:
        return 0.0
    return otherwise


@compiled
def take(memory: Memory, value: float) -> float:
    """Return the next input within [0, 1]; what is not a number is no move."""
    memory.last[RAW] = clamp(value, memory.last[RAW])
    return memory.last[RAW]


@compiled
def backlash(memory: Memory, value: float, width: float) -> float:
    """Return the input that the memory sees behind a dead-band, so that noise makes no extrema."""
    half = 0.5 * width
    return min(max(memory.last[SEEN], value - half), value + half)


@compiled
def _remember(memory: Memory, side: int, place: int) -> None:
    """Write the last input and what the operators hold there into a place of a stack."""
    memory.levels[side, place] = memory.last[SEEN]
    for j in range(memory.now.size):
        memory.values[side, place, j] = memory.now[j]


@compiled
def locate(memory: Memory, value: float) -> MemoryLoop:
    """Return the loop in which a new input lies; what is remembered does not change.

    At a reversal the last input becomes an extremum: it is written into the first free place, which
    counts only from `commit` on. Deletion comes before evaluation, and equality deletes.
    """
    levels, counts = memory.levels, memory.counts
    last = memory.last[SEEN]
    maxima, minima = counts[MAXIMUM], counts[MINIMUM]
    rising = counts[RISING] == 1
    if value > last:
        if not rising:
            _remember(memory, MINIMUM, minima)
            minima += 1
        while maxima > 1 and value >= levels[MAXIMUM, maxima - 1]:
            maxima -= 1
            minima -= 1
        rising = True
    elif value < last:
        if rising:
            _remember(memory, MAXIMUM, maxima)
            maxima += 1
        while minima > 1 and value <= levels[MINIMUM, minima - 1]:
            minima -= 1
            maxima -= 1
        rising = False
    return MemoryLoop(rising, maxima, minima)


@compiled
def commit(memory: Memory, loop: MemoryLoop, value: float) -> bool:
    """Make an input that was located, and evaluated into `now`, the last one.

    Return whether the stacks were full, so that a pair of extrema was given up.
    """
    counts = memory.counts
    counts[MAXIMUM] = loop.maxima
    counts[MINIMUM] = loop.minima
    counts[RISING] = 1 if loop.rising else 0
    memory.last[SEEN] = value
    full = max(loop.maxima, loop.minima) == memory.levels.shape[1]
    if full:
        _merge(memory)
    return full


@compiled
def _merge(memory: Memory) -> None:
    """Delete the pair of neighbouring extrema whose loss changes the memory least.

    From the outside in, the extrema are maximum 1, minimum 1, maximum 2, ... Without a pair of
    neighbours the staircase of the Preisach plane loses a rectangle between these two and those
    around them; the longer sides are compared, so that what is left stays evenly spaced.
    The loop on top, in which the input moves, stays: the output does not jump now.
    """
    levels, counts = memory.levels, memory.counts
    smallest, at_maximum, at_minimum = np.inf, 0, 0
    for i in range(1, counts[MINIMUM] - 1):
        drop = levels[MAXIMUM, i] - levels[MAXIMUM, i + 1]
        side = max(drop, levels[MINIMUM, i] - levels[MINIMUM, i - 1])  # maximum i, minimum i
        if side < smallest:
            smallest, at_maximum, at_minimum = side, i, i
        side = max(drop, levels[MINIMUM, i + 1] - levels[MINIMUM, i])  # minimum i, maximum i + 1
        if side < smallest:
            smallest, at_maximum, at_minimum = side, i + 1, i
    _drop(memory, MAXIMUM, at_maximum)
    _drop(memory, MINIMUM, at_minimum)
    counts[MERGED] += 1


@compiled
def _drop(memory: Memory, side: int, index: int) -> None:
    """Remove one extremum, closing the gap."""
    count = memory.counts[side]
    for i in range(index, count - 1):
        memory.levels[side, i] = memory.levels[side, i + 1]
        for j in range(memory.now.size):
            memory.values[side, i, j] = memory.values[side, i + 1, j]
    memory.counts[side] = count - 1
