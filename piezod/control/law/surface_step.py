"""One step of the compensator for a surface, compiled with numba.

The memory of a surface follows the drive. The drive that was applied is known, so that the memory
advances with it directly; only the command has to be inverted.
"""

from collections.abc import Callable
from functools import partial
from math import isfinite

import numpy as np

from piezod.control.law.creep import CreepState
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.everett_memory import (
    advance_drive,
    displacement,
    displacement_at,
    drive_for,
    new_surface_memory,
)
from piezod.hysteresis.memory import MERGED, FloatArray, IntArray, Memory, clamp
from piezod.jit import compiled

DRIVE, COMMAND, BEYOND, OUTSIDE, POSITION = 0, 1, 2, 3, 4
"""Indices of the array that carries values to the next step.

- DRIVE: drive to which the memory will advance if it was applied; NaN for none.
- COMMAND, BEYOND, OUTSIDE: as in `piezod.control.law.step`.
- POSITION: displacement at that drive.
"""


@compiled
def step(  # noqa: D417 - arguments are described in groups
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    pending: FloatArray,
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

    The memory and the lags first advance with the last drive. All quantities are normalised.

    Args:
        levels, values, now, last, counts: Arrays of a memory of drives.
        pending: (5,) values that are carried from one step to the next.
        weights, target, share: (24,) coefficients in use; those that they approach; share of the
            remaining distance that they move in this step.
        lags, creep_gains, creep_weights: (K,) lags, gains and weights of the creep.
        strength: 0 for a drive in proportion to the command, 1 for a compensated drive.
        command, stretch, added: Command; its factor, and the displacement added to the product,
            before it is compensated.
        low, high: Lowest and highest drive.
    """
    memory = Memory(levels, values, now, last, counts)
    if pending[DRIVE] == pending[DRIVE]:
        advance_drive(memory, 0.0, pending[DRIVE])
    # The hysteresis only has to make what the creep has not yet made.
    crept = advance_creep(lags, creep_gains, creep_weights, displacement(weights, memory.now))
    for j in range(weights.size):
        weights[j] += share * (target[j] - weights[j])
    command = clamp(command, pending[COMMAND])
    requested_position = stretch * command + added - crept
    position = clamp(requested_position, command)
    model = drive_for(memory, weights, position)
    requested_drive = model + (1.0 - strength) * (command - model)
    drive = min(max(requested_drive, low), high)
    if drive != model:
        position = displacement_at(memory, weights, clamp(drive, memory.last[0]))
    pending[DRIVE] = drive
    pending[COMMAND] = command
    pending[BEYOND] = requested_drive - drive
    pending[OUTSIDE] = requested_position - clamp(requested_position, command)
    pending[POSITION] = position
    return drive


class SurfaceKernel:
    """Kernel of the compensator for a surface, on a memory of drives.

    Args:
        weights: (24,) coefficients in use; they change in place.
        creep: Creep so far, and the displacement; its lags change in place.
    """

    def __init__(self, weights: FloatArray, creep: CreepState) -> None:
        self._memory, self._weights = new_surface_memory(), weights
        drive = drive_for(self._memory, weights, creep.quick)
        self._pending = np.array([drive, creep.quick, 0.0, 0.0, creep.quick])
        # Bound once, as in `StopKernel`.
        self.step: Callable[
            [FloatArray, float, float, float, float, float, float, float], float
        ] = partial(
            step,
            *self._memory,
            self._pending,
            weights,
            creep.lags,
            creep.creep.gains,
            creep.creep.weights,
        )

    @property
    def position(self) -> float:
        """Displacement of the hysteresis after the last drive that was applied."""
        if isfinite(self._pending.item(DRIVE)):
            position: float = self._pending.item(POSITION)
            return position
        return displacement(self._weights, self._memory.now)

    @property
    def beyond(self) -> float:
        """How far the last requested drive lay outside the window; negative below it."""
        beyond: float = self._pending.item(BEYOND)
        return beyond

    @property
    def outside(self) -> float:
        """How far the last requested displacement lay outside the range; negative below it."""
        outside: float = self._pending.item(OUTSIDE)
        return outside

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return int(self._memory.counts[MERGED])

    def discard_last(self) -> None:
        """Take back the last drive: it was not applied."""
        self._pending[DRIVE] = np.nan
