"""The modified Prandtl-Ishlinskii model in closed form: one scalar per loop, two table look-ups.

With fixed weights the memory of all operators of paper eq. (9) collapses to one scalar per loop.
Let φ^a be the rising major branch, set by the right weights. Let φ^d be the falling major branch,
measured down from the top and set by the left weights. Both are piecewise linear with knots at the
thresholds. A loop from (v_m, x_m) to (v_M, x_M) of width Δ keeps a scalar S_l at its minimum, and
S_r = 1 / (S_l Δ) at its maximum:

    rising:  x = x_m + φ^a(S_l u) / S_l + u (S_l φ^d(1 / S_l) - 1),   u = v - v_m
    falling: x = x_M - φ^d(S_r u) / S_r - u (S_r φ^a(1 / S_r) - 1),   u = v_M - v

The outermost loop has S_l = S_r = 1. A new maximum takes its S_r from the S_l of the minimum below
it, and a new minimum takes its S_l from the S_r of the maximum above it. The cost of a sample does
not depend on the number of operators. Between reversals x is piecewise linear in v. The exact
inverse therefore needs one search among the same knots, on the same memory with x as its key.

This form is not in the paper. `docs/mathematics.md` states it; the tests compare it with the
operators.
"""

import numpy as np

from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    MAXIMUM,
    MINIMUM,
    RISING,
    SEEN,
    FloatArray,
    IntArray,
    Memory,
    MemoryLoop,
    accept_input,
    backlash,
    commit,
    locate,
    new_memory,
    relax,
)
from piezod.jit import compiled

OUTPUT, SCALE, CHORD = 0, 1, 2
"""Values stored at each extremum: the output, S, and S φ(1 / S) of the opposite branch."""
KNOTS, HEIGHTS, SLOPES = 0, 1, 2
"""Rows of a branch, shape (3, M + 2): knots from 0 to 1, φ there, slope from there on."""

_SMALLEST_PART = 1e-18  # keeps S finite if rounding closes a loop that is a few ulp wide


def branch(thresholds: FloatArray, weights: FloatArray) -> FloatArray:
    """Return a major branch φ as a table of knots, heights and slopes, shape (3, M + 2).

    The heights are φ(r_J) of paper eq. (20); with play weights -a (1 - r') / r' they are ψ(r'_J) of
    paper eq. (21). The slope between r_{J-1} and r_J is, by paper eq. (22) with its missing term,

        φ'_J = 1 - Σ_{j≥J} q_j + Σ_{j<J} q_j r_j / (1 - r_j).

    Args:
        thresholds: (M,) strictly increasing in (0, 1).
        weights: (M,) weights q of the plays on this branch.
    """
    knots = np.concatenate(([0.0], thresholds, [1.0]))
    # Plays with r_j below v rise with the slope 1 / (1 - r_j); the others are still flat.
    passed = np.concatenate(([0.0], np.cumsum(weights * thresholds / (1.0 - thresholds))))
    ahead = np.concatenate((np.cumsum(weights[::-1])[::-1], [0.0]))
    slopes = 1.0 - ahead + passed
    heights = np.concatenate(([0.0], np.cumsum(slopes * np.diff(knots))))
    # The last slope is repeated, so that all rows have M + 2 columns.
    return np.stack((knots, heights, np.append(slopes, slopes[-1])))


def new_loop_memory(capacity: int = DEFAULT_CAPACITY) -> Memory:
    """Return a relaxed memory for the closed form."""
    memory = new_memory(width=3, capacity=capacity)
    relax_loops(memory)
    return memory


def relax_loops(memory: Memory) -> None:
    """Return a memory of the closed form to its relaxed state."""
    relax(memory)
    memory.values[:, 0, SCALE:] = 1.0  # S = 1 for the outermost loop, and φ(1) = 1


@compiled
def _branch_height(table: FloatArray, knot: float) -> float:
    """Return φ at a point of [0, 1]; outside, the outermost cell is extended."""
    # Bisection for the cell that contains the point.
    low, high = 0, table.shape[1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[KNOTS, middle] <= knot:
            low = middle
        else:
            high = middle
    return table[HEIGHTS, low] + table[SLOPES, low] * (knot - table[KNOTS, low])


@compiled
def _branch_point(table: FloatArray, chord: float, height: float) -> float:
    """Return the point t at which φ(t) + chord t reaches a height; all slopes must be positive."""
    # The same bisection; the sum rises with t, because all its slopes are positive.
    low, high = 0, table.shape[1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[HEIGHTS, middle] + chord * table[KNOTS, middle] <= height:
            low = middle
        else:
            high = middle
    start = table[HEIGHTS, low] + chord * table[KNOTS, low]
    return table[KNOTS, low] + (height - start) / (table[SLOPES, low] + chord)


@compiled
def _set_scale(extremum: FloatArray, part: float, opposite: FloatArray) -> None:
    """Write S = 1 / part and its chord S φ(1 / S) at an extremum."""
    part = max(part, _SMALLEST_PART)
    extremum[SCALE] = 1.0 / part
    extremum[CHORD] = _branch_height(opposite, part) / part


@compiled
def _drive_at(memory: Memory, side: int, place: int, output_is_drive: bool) -> float:
    """Return the drive v at an extremum: an input of the model, but an output of its inverse."""
    if output_is_drive:
        return memory.values[side, place, OUTPUT]
    return memory.levels[side, place]


@compiled
def _prepare_reversal(
    memory: Memory, up: FloatArray, down: FloatArray, value: float, output_is_drive: bool
) -> None:
    """Set scale and chord of the extremum that `locate` will store if the input reverses."""
    rising = memory.counts[RISING] == 1
    if (value > memory.last[SEEN]) == rising or value == memory.last[SEEN]:
        return  # no reversal
    # S_r = 1 / (S_l Δ), where Δ is the width of the loop in drive units, also for the inverse.
    now, drive = memory.now, memory.now[OUTPUT] if output_is_drive else memory.last[SEEN]
    if rising:
        m = memory.counts[MINIMUM] - 1
        width = drive - _drive_at(memory, MINIMUM, m, output_is_drive)
        _set_scale(now, memory.values[MINIMUM, m, SCALE] * width, up)
    else:
        m = memory.counts[MAXIMUM] - 1
        width = _drive_at(memory, MAXIMUM, m, output_is_drive) - drive
        _set_scale(now, memory.values[MAXIMUM, m, SCALE] * width, down)


@compiled
def _rescale(memory: Memory, up: FloatArray, down: FloatArray, output_is_drive: bool) -> None:
    """Set the scales of all extrema anew after a pair of extrema was removed.

    The outputs stay, so that nothing jumps now. With the old scales, a loop that takes the place of
    a narrower one would miss its end by several per cent of the range.
    """
    values = memory.values
    # From the outside in, because each scale follows from that of the extremum before it.
    for i in range(1, memory.counts[MAXIMUM]):
        v_max = _drive_at(memory, MAXIMUM, i, output_is_drive)
        width = v_max - _drive_at(memory, MINIMUM, i - 1, output_is_drive)
        _set_scale(values[MAXIMUM, i], values[MINIMUM, i - 1, SCALE] * width, up)
        if i < memory.counts[MINIMUM]:
            width = v_max - _drive_at(memory, MINIMUM, i, output_is_drive)
            _set_scale(values[MINIMUM, i], values[MAXIMUM, i, SCALE] * width, down)


@compiled
def _forward(
    memory: Memory, up: FloatArray, down: FloatArray, loop: MemoryLoop, value: float
) -> float:
    """Return x for an input v in its loop: the forward model, paper eq. (9), in closed form."""
    levels, values = memory.levels, memory.values
    if loop.rising:
        m = loop.minima - 1
        u, scale = value - levels[MINIMUM, m], values[MINIMUM, m, SCALE]
        rise = _branch_height(up, scale * u) / scale + u * (values[MINIMUM, m, CHORD] - 1.0)
        return values[MINIMUM, m, OUTPUT] + rise
    m = loop.maxima - 1
    u, scale = levels[MAXIMUM, m] - value, values[MAXIMUM, m, SCALE]
    fall = _branch_height(down, scale * u) / scale + u * (values[MAXIMUM, m, CHORD] - 1.0)
    return values[MAXIMUM, m, OUTPUT] - fall


@compiled
def _inverse(
    memory: Memory, up: FloatArray, down: FloatArray, loop: MemoryLoop, value: float
) -> float:
    """Return v for an output x in its loop: `_forward` solved for v."""
    levels, values = memory.levels, memory.values
    if loop.rising:
        m = loop.minima - 1
        # The rising formula times S: φ^a(t) + t (chord - 1) = S (x - x_m), with t = S u.
        scale = values[MINIMUM, m, SCALE]
        rise = scale * (value - levels[MINIMUM, m])
        u = _branch_point(up, values[MINIMUM, m, CHORD] - 1.0, rise) / scale
        return values[MINIMUM, m, OUTPUT] + u
    m = loop.maxima - 1
    scale = values[MAXIMUM, m, SCALE]
    fall = scale * (levels[MAXIMUM, m] - value)
    u = _branch_point(down, values[MAXIMUM, m, CHORD] - 1.0, fall) / scale
    return values[MAXIMUM, m, OUTPUT] - u


@compiled
def _advance(
    memory: Memory, up: FloatArray, down: FloatArray, invert: bool, deadband: float, value: float
) -> float:
    """Advance by one input and return the output: v to x, or x to v if `invert` is set.

    Within the dead-band the output follows the raw input with the slope just after a reversal.
    """
    value = accept_input(memory, value)
    seen = backlash(memory, value, deadband)
    _prepare_reversal(memory, up, down, seen, invert)
    loop = locate(memory, seen)
    if invert:
        memory.now[OUTPUT] = _inverse(memory, up, down, loop, seen)
    else:
        memory.now[OUTPUT] = _forward(memory, up, down, loop, seen)
    if commit(memory, loop, seen):
        _rescale(memory, up, down, invert)
    # Derivative of both formulas at u = 0 in a narrow loop, where S is large and φ(1/S) S = φ'_1.
    slope = up[SLOPES, 0] + down[SLOPES, 0] - 1.0
    return memory.now[OUTPUT] + (value - seen) * (1.0 / slope if invert else slope)


@compiled
def step(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    up: FloatArray,
    down: FloatArray,
    invert: bool,
    deadband: float,
    value: float,
) -> float:
    """Advance by one input and return the output. Real-time safe.

    The arrays are separate arguments because a call from Python costs least that way.
    """
    memory = Memory(levels, values, now, last, counts)
    return _advance(memory, up, down, invert, deadband, value)


@compiled
def run(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    up: FloatArray,
    down: FloatArray,
    invert: bool,
    deadband: float,
    inputs: FloatArray,
    outputs: FloatArray,
) -> None:
    """Advance by inputs of shape (n,) and write the outputs, shape (n,)."""
    memory = Memory(levels, values, now, last, counts)
    for k in range(inputs.size):
        outputs[k] = _advance(memory, up, down, invert, deadband, inputs[k])


def smallest_slope(up: FloatArray, down: FloatArray) -> float:
    """Return the smallest slope dx/dv of the model anywhere, on the major loop or inside it.

    The model is invertible from every reachable state if and only if this slope is positive. The
    slope just after a reversal in a narrow loop is the slope of one branch plus a chord of the
    other branch minus 1. For an inverse on the major loop alone, positive slopes of both branches
    suffice.
    """
    chord_up = float(np.min(up[HEIGHTS, 1:] / up[KNOTS, 1:]))
    chord_down = float(np.min(down[HEIGHTS, 1:] / down[KNOTS, 1:]))
    # A chord starts at the reversal, the origin of the branch; h / r is its slope up to a knot.
    rising = float(np.min(up[SLOPES])) + chord_down
    falling = float(np.min(down[SLOPES])) + chord_up
    return min(rising, falling) - 1.0
