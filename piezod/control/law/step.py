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
from piezod.hysteresis.bank import advance_plays, drive_at, new_bank_memory, position_for
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.memory import (
    MERGED,
    SEEN,
    FloatArray,
    IntArray,
    Memory,
    assign_memory,
    clamp,
)
from piezod.jit import compiled


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
    model = drive_at(memory, bank, plays, weights, position)
    requested_drive = model + (1.0 - strength) * (command - model)
    drive = min(max(requested_drive, low), high)
    if drive != model:  # at full strength, within the window, they are equal to the bit
        position = position_for(memory, bank, plays, weights, drive)
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
        if creep.memory is not None:
            assign_memory(self._memory, creep.memory)
        self.carried: FloatArray = np.empty(CARRIED)
        self.carried[[NEXT, COMMAND, POSITION]] = creep.quick, creep.shown, creep.quick
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
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return int(self._memory.counts[MERGED])

    def discard_last(self) -> None:
        """Take back the last drive: it was not applied."""
        self.carried[NEXT], self.carried[POSITION] = np.nan, self._memory.last[SEEN]
