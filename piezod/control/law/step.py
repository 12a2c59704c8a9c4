"""One step of the compensator for a sum of stops, compiled with numba.

Each cycle of the loop, and each sample of an experiment, makes this step for every axis. So all of
it is one compiled function, and its arguments are single arrays and numbers by position: numba
takes an object apart at each call, which costs more than the arithmetic. `StopKernel` binds the
arrays once, so that a caller gives eight numbers. What one step leaves to the next is in `carried`,
whose indices `kernel` explains.
"""

from collections.abc import Callable
from functools import partial
from math import isfinite

import numpy as np

from piezod.control.law.creep import CreepState
from piezod.control.law.kernel import BEYOND, CARRIED, COMMAND, CREPT, NEXT, OUTSIDE, POSITION
from piezod.hysteresis.bank import advance_plays, evaluate_plays, new_bank_memory, weighted_sum
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.memory import MERGED, SEEN, FloatArray, IntArray, Memory, clamp, locate
from piezod.jit import compiled

_MAX_STEPS = 50  # of the search for a displacement; about ten are needed
_SAME_DRIVE = 1e-13  # a smaller difference of drives is rounding


@compiled
def _model(
    memory: Memory, bank: FloatArray, plays: FloatArray, weights: FloatArray, position: float
) -> float:
    """Return the drive for a displacement, paper eq. (16); the memory does not change."""
    evaluate_plays(memory, bank, locate(memory, position), position, plays)
    return weighted_sum(plays, bank, weights, position)


@compiled
def _position(
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
        miss = _model(memory, bank, plays, weights, middle) - drive
    return middle


@compiled
def step(  # noqa: D417 - arguments are described in groups
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    plays: FloatArray,
    carried: FloatArray,
    weights: FloatArray,
    lags: FloatArray,
    creep_gains: FloatArray,
    creep_weights: FloatArray,
    target: FloatArray,
    share: float,
    strength: float,
    command: float,
    stretch: float,
    added: float,
    low: float,
    high: float,
) -> float:
    """Return the drive for a command. Real-time safe.

    The memory and the lags first advance to the displacement that the last drive has caused.
    Positional arguments and single arrays cost least in numba.

    Args:
        levels, values, now, last, counts: Arrays of a `Memory`.
        bank, plays: (2, 2 M) thresholds and gains of the stops; (2 M,) buffer for the plays.
        carried: (6,) values that are carried from one step to the next.
        weights, target, share: (2 M,) weights in use; the weights that they approach; share of the
            remaining distance that they move in this step.
        lags, creep_gains, creep_weights: (K,) lags, gains and weights of the creep.
        strength: 0 for a drive in proportion to the command, 1 for a compensated drive.
        command, stretch, added: Command; its factor; displacement added to the product.
        low, high: Lowest and highest drive.
    """
    memory = Memory(levels, values, now, last, counts)
    if carried[NEXT] == carried[NEXT]:  # not NaN
        advance_plays(memory, bank, 0.0, carried[NEXT])
    # The hysteresis only has to make what the creep has not yet made.
    crept = advance_creep(lags, creep_gains, creep_weights, memory.last[SEEN])
    for j in range(weights.size):
        weights[j] += share * (target[j] - weights[j])
    command = clamp(command, carried[COMMAND])
    requested_position = stretch * command + added - crept
    position = clamp(requested_position, command)
    carried[OUTSIDE] = requested_position - position
    model = _model(memory, bank, plays, weights, position)
    requested_drive = model + (1.0 - strength) * (command - model)
    drive = min(max(requested_drive, low), high)
    if drive != model:  # at full strength, within the window, they are equal to the bit
        position = _position(memory, bank, plays, weights, drive)
    carried[NEXT] = position
    carried[POSITION] = position if isfinite(position) else memory.last[SEEN]  # NaN: it stays
    carried[COMMAND], carried[CREPT] = command, crept
    carried[BEYOND] = requested_drive - drive
    return drive


class StopKernel:
    """Kernel of the compensator for a sum of stops, on a memory of displacements.

    Args:
        bank: (2, 2 M) thresholds and gains of the stops, from `new_bank`.
        weights: (2 M,) weights [a^l, a^r] in use; they change in place.
        creep: Creep so far, and the displacement; its lags change in place.
    """

    def __init__(self, bank: FloatArray, weights: FloatArray, creep: CreepState) -> None:
        self._memory = new_bank_memory(bank)
        self.carried: FloatArray = np.empty(CARRIED)
        self.carried[[NEXT, COMMAND, POSITION]] = creep.quick
        self.carried[[BEYOND, OUTSIDE]] = 0.0
        self.carried[CREPT] = float(creep.creep.weights @ creep.lags)
        # The arrays keep their identity, so that they are bound once. A partial function adds no
        # Python frame to the step.
        self.step: Callable[
            [FloatArray, float, float, float, float, float, float, float], float
        ] = partial(
            step,
            *self._memory,
            bank,
            np.empty(bank.shape[1]),
            self.carried,
            weights,
            creep.lags,
            creep.creep.gains,
            creep.creep.weights,
        )

    @property
    def relaxing(self) -> float:
        """0: stops remember turning points only."""
        return 0.0

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return int(self._memory.counts[MERGED])

    def discard_last(self) -> None:
        """Take back the last drive: it was not applied."""
        self.carried[NEXT], self.carried[POSITION] = np.nan, self._memory.last[SEEN]
