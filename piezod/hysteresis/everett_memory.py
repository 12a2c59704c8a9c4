"""The memory of a surface: the 24 regressors of the displacement at each extremum of the drive.

A surface (`everett`) tells how far a stage moves in one loop of the drive; the displacement is a
sum over all loops that are open. A cycle has no time to form this sum anew: the memory keeps the
part of it that no longer changes. The regressors are sums of `everett.fill_basis` over the loops
that the drive has left open. They do not depend on the coefficients, so that the coefficients may
change at any time. Between reversals one term changes, so that a step costs the same for any past:

    rising:  b = b_m + basis(v, v_m),     falling:  b = b_M - basis(v_M, v),

with the innermost minimum v_m and maximum v_M; the displacement is the sum of c_ij b_ij. Where the
hysteresis depends on the rate, v is the lagging drive of `rate_lag`. What `path_relaxation` adds is
no function of the extrema; its state advances with them.
"""

from piezod.hysteresis.everett import SIZE, fill_basis, surface
from piezod.hysteresis.memory import (
    CHANGE,
    DEFAULT_CAPACITY,
    MAXIMUM,
    MINIMUM,
    RAW,
    RISING,
    SEEN,
    FloatArray,
    Memory,
    MemoryLoop,
    accept_input,
    backlash,
    commit,
    locate,
    new_memory,
)
from piezod.hysteresis.path_relaxation import WEIGHT, advance_path, path_change
from piezod.hysteresis.rate_lag import (
    PROMPT,
    lag_of,
    lag_slope,
    lagging_drive,
)
from piezod.jit import compiled

_MAX_STEPS = 60
"""Largest number of steps of the search for a drive; three to six are needed."""
_SAME = 1e-14  # a smaller difference of displacements is rounding


def new_surface_memory(capacity: int = DEFAULT_CAPACITY) -> Memory:
    """Return a relaxed memory for the regressors."""
    memory = new_memory(SIZE, capacity)
    relax_surface(memory)
    return memory


def relax_surface(memory: Memory) -> None:
    """Complete a relaxed memory: the outermost maximum lies on the branch from 0 to 1."""
    fill_basis(1.0, 0.0, memory.values[MAXIMUM, 0])


@compiled
def advance_drive(memory: Memory, terms: FloatArray, deadband: float, drive: float) -> float:
    """Advance all regressors in `memory.now` by one drive; return it clamped. Real-time safe."""
    drive = accept_input(memory, drive)
    seen = backlash(memory, lagging_drive(terms, memory.last[SEEN], drive), deadband)
    loop = locate(memory, seen)
    now = memory.now
    if loop.rising:
        start = loop.minima - 1
        fill_basis(seen, memory.levels[MINIMUM, start], now)
        for j in range(now.size):
            now[j] += memory.values[MINIMUM, start, j]
    else:
        start = loop.maxima - 1
        fill_basis(memory.levels[MAXIMUM, start], seen, now)
        for j in range(now.size):
            now[j] = memory.values[MAXIMUM, start, j] - now[j]
    commit(memory, loop, seen)
    advance_path(terms, memory.last, seen)
    return drive


@compiled
def displacement_beside(memory: Memory, terms: FloatArray) -> float:
    """Return the displacement beside the surface after the last drive. Real-time safe."""
    last = memory.last
    return _beside(terms, last[RAW] - last[SEEN], last[CHANGE])


@compiled
def _beside(terms: FloatArray, lag: float, change: float) -> float:
    """Return the displacement beside the surface: the prompt part, and the part that relaxes."""
    return terms[PROMPT] * lag + terms[WEIGHT] * change


@compiled
def displacement(coefficients: FloatArray, regressors: FloatArray) -> float:
    """Return the displacement of the surface from its regressors, shape (24,). Real-time safe."""
    # The sum runs in a fixed order, so that steps and runs agree to the bit.
    total = 0.0
    for j in range(coefficients.size):
        total += coefficients[j] * regressors[j]
    return total


@compiled
def branch_move(
    memory: Memory, coefficients: FloatArray, loop: MemoryLoop, drive: float
) -> tuple[int, int, float]:
    """Return the extremum at which the branch to a located drive begins, and the move since.

    The extremum is given by its side and its place in the memory. Real-time safe.
    """
    if loop.rising:
        start = loop.minima - 1
        rise, _, _ = surface(coefficients, drive, memory.levels[MINIMUM, start])
        return MINIMUM, start, rise
    start = loop.maxima - 1
    fall, _, _ = surface(coefficients, memory.levels[MAXIMUM, start], drive)
    return MAXIMUM, start, -fall


def new_displacement_memory(coefficients: FloatArray) -> Memory:
    """Return a relaxed memory of the displacements of one surface, for `advance_displacement`."""
    memory = new_memory(1)
    memory.values[MAXIMUM, 0, 0] = surface(coefficients, 1.0, 0.0)[0]
    return memory


@compiled
def advance_displacement(
    memory: Memory, coefficients: FloatArray, terms: FloatArray, drive: float
) -> float:
    """Advance a memory of displacements by one drive; return the displacement. Real-time safe.

    With fixed coefficients one displacement stands for its 24 regressors, which takes a fraction of
    the time. The memory comes from `new_displacement_memory`.
    """
    seen = lagging_drive(terms, memory.last[SEEN], accept_input(memory, drive))
    loop = locate(memory, seen)
    side, start, move = branch_move(memory, coefficients, loop, seen)
    memory.now[0] = memory.values[side, start, 0] + move
    commit(memory, loop, seen)
    advance_path(terms, memory.last, seen)
    return memory.now[0] + displacement_beside(memory, terms)


@compiled
def _solve(
    coefficients: FloatArray,
    terms: FloatArray,
    last: FloatArray,
    start: float,
    rise: float,
    low: float,
    high: float,
    guess: float,
) -> float:
    """Return the end of a branch that begins at `start` and ends `rise` from its displacement.

    Newton's method, with bisection where a step would leave the bracket [low, high]. The start lies
    below the bracket on a rising branch, and above it on a falling one.
    """
    rising = start <= low
    drive = guess if low < guess < high else 0.5 * (low + high)
    for _ in range(_MAX_STEPS):
        change, relaxing = path_change(terms, last, drive)
        beside = _beside(terms, lag_of(terms, last[SEEN], drive), change)
        if rising:
            value, slope, _ = surface(coefficients, drive, start)
            miss = value + beside - rise
        else:
            value, _, slope = surface(coefficients, start, drive)
            miss = rise - value + beside
        if abs(miss) < _SAME:
            break
        if miss > 0.0:
            high = drive
        else:
            low = drive
        drive -= miss / (slope + _beside(terms, lag_slope(terms, last[SEEN], drive), relaxing))
        if not low < drive < high:
            drive = 0.5 * (low + high)
    return drive


@compiled
def _at(
    memory: Memory, coefficients: FloatArray, terms: FloatArray, side: int, place: int
) -> float:
    """Return the displacement that a move would have at an extremum."""
    level, last = memory.levels[side, place], memory.last
    change, _ = path_change(terms, last, level)
    beside = _beside(terms, lag_of(terms, last[SEEN], level), change)
    return displacement(coefficients, memory.values[side, place]) + beside


@compiled
def drive_for(
    memory: Memory, coefficients: FloatArray, terms: FloatArray, position: float
) -> float:
    """Return the drive in [0, 1] that moves the stage to a displacement. Real-time safe.

    The memory does not change. Every branch is monotone. The displacements of the extrema therefore
    have the order of their drives, and the rule of deletion holds for displacements, too. If no
    drive reaches the displacement, the result is the nearest end of the range.
    """
    last = memory.last[SEEN]
    lagging = _lagging_for(memory, coefficients, terms, position)
    return min(max(lagging + lag_of(terms, last, lagging), 0.0), 1.0)


@compiled
def _lagging_for(
    memory: Memory, coefficients: FloatArray, terms: FloatArray, position: float
) -> float:
    """Return the lagging drive that moves the stage to a displacement, or the nearest in [0, 1]."""
    levels, values, counts, last = memory.levels, memory.values, memory.counts, memory.last[SEEN]
    of_surface = displacement(coefficients, memory.now)
    now = of_surface + _beside(terms, 0.0, memory.last[CHANGE])
    # Slopes are near one, so that the drive moves by about as much as the displacement.
    guess = last + position - of_surface - displacement_beside(memory, terms)
    maxima, minima, low, high = counts[MAXIMUM], counts[MINIMUM], last, last
    if position > now:
        start, at_start, inside = last, of_surface, counts[RISING] == 0
        minima += inside  # the last drive would become a minimum
        while maxima > 1 and position >= _at(memory, coefficients, terms, MAXIMUM, maxima - 1):
            low = levels[MAXIMUM, maxima - 1]
            maxima -= 1
            minima -= 1
        high = levels[MAXIMUM, maxima - 1]
        if position >= _at(memory, coefficients, terms, MAXIMUM, maxima - 1):
            return high
        if not inside or minima <= counts[MINIMUM]:
            start = levels[MINIMUM, minima - 1]
            at_start = displacement(coefficients, values[MINIMUM, minima - 1])
        return _solve(
            coefficients, terms, memory.last, start, position - at_start, low, high, guess
        )
    if position < now:
        start, at_start, inside = last, of_surface, counts[RISING] == 1
        maxima += inside  # the last drive would become a maximum
        while minima > 1 and position <= _at(memory, coefficients, terms, MINIMUM, minima - 1):
            high = levels[MINIMUM, minima - 1]
            minima -= 1
            maxima -= 1
        low = levels[MINIMUM, minima - 1]
        if position <= _at(memory, coefficients, terms, MINIMUM, minima - 1):
            return low
        if not inside or maxima <= counts[MAXIMUM]:
            start = levels[MAXIMUM, maxima - 1]
            at_start = displacement(coefficients, values[MAXIMUM, maxima - 1])
        return _solve(
            coefficients, terms, memory.last, start, at_start - position, low, high, guess
        )
    return last


@compiled
def displacement_at(
    memory: Memory, coefficients: FloatArray, terms: FloatArray, drive: float
) -> float:
    """Return the displacement to which a drive would move the stage; the memory does not change.

    Real-time safe.
    """
    lagging = lagging_drive(terms, memory.last[SEEN], drive)
    side, start, move = branch_move(memory, coefficients, locate(memory, lagging), lagging)
    change, _ = path_change(terms, memory.last, lagging)
    beside = _beside(terms, drive - lagging, change)
    return displacement(coefficients, memory.values[side, start]) + move + beside


@compiled
def invert_record(
    memory: Memory,
    coefficients: FloatArray,
    terms: FloatArray,
    deadband: float,
    positions: FloatArray,
    drives: FloatArray,
) -> None:
    """Write the drives for a record of displacements, shape (n,) each. Real-time safe."""
    for k in range(positions.size):
        drives[k] = drive_for(memory, coefficients, terms, positions[k])
        advance_drive(memory, terms, deadband, drives[k])
