"""One step of the compensator for a surface, compiled with numba.

The memory of a surface follows the drive. The drive that was applied is known, so that the memory
advances with it directly; only the command has to be inverted.
"""

from collections.abc import Callable
from functools import partial
from math import isfinite

import numpy as np

from piezod.control.law.creep import CreepState
from piezod.control.law.kernel import BEYOND, CARRIED, COMMAND, CREPT, NEXT, OUTSIDE, POSITION
from piezod.hysteresis import SurfaceForm
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.everett_memory import (
    advance_drive,
    displacement,
    displacement_at,
    displacement_beside,
    drive_for,
    new_surface_memory,
)
from piezod.hysteresis.memory import (
    MERGED,
    RAW,
    FloatArray,
    IntArray,
    Memory,
    assign_memory,
    clamp,
)
from piezod.hysteresis.path_relaxation import FAST
from piezod.jit import compiled


@compiled
def step(  # noqa: D417 - arguments are described in groups
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    carried: FloatArray,
    terms: FloatArray,
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
        carried, terms: (6,) values that are carried from one step to the next; (8,) constants of
            the optional terms of the surface.
        weights, target, share: (24,) coefficients in use; those that they approach; share of the
            remaining distance that they move in this step.
        lags, creep_gains, creep_weights: (K,) lags, gains and weights of the creep.
        strength: 0 for a drive in proportion to the command, 1 for a compensated drive.
        command, stretch, added: Command; its factor, and the displacement added to the product,
            before it is compensated.
        low, high: Lowest and highest drive.
    """
    memory = Memory(levels, values, now, last, counts)
    if carried[NEXT] == carried[NEXT]:  # not NaN
        advance_drive(memory, terms, 0.0, carried[NEXT])
    # The hysteresis only has to make what the creep has not yet made.
    crept = advance_creep(lags, creep_gains, creep_weights, _position(memory, weights, terms))
    for j in range(weights.size):
        weights[j] += share * (target[j] - weights[j])
    command = clamp(command, carried[COMMAND])
    requested_position = stretch * command + added - crept
    model, carried[OUTSIDE] = _model_drive(memory, weights, terms, requested_position, command)
    requested_drive = model + (1.0 - strength) * (command - model)
    drive = min(max(requested_drive, low), high)
    carried[NEXT] = drive
    position = displacement_at(memory, weights, terms, clamp(drive, memory.last[RAW]))
    if position - position == 0.0:  # weights that are not finite leave it
        carried[POSITION] = position
    carried[COMMAND], carried[CREPT] = command, crept
    carried[BEYOND] = requested_drive - drive
    return drive


@compiled
def _model_drive(
    memory: Memory, weights: FloatArray, terms: FloatArray, requested: float, command: float
) -> tuple[float, float]:
    """Return the drive for a displacement, and how far the displacement is out of reach."""
    if terms[FAST] == 0.0:
        position = clamp(requested, command)
        return drive_for(memory, weights, terms, position), requested - position
    # Loops that do not close leave [0, 1], at drives inside the range.
    drive = drive_for(memory, weights, terms, requested)
    if 0.0 < drive < 1.0:
        return drive, 0.0
    return drive, requested - displacement_at(memory, weights, terms, drive)


@compiled
def _position(memory: Memory, weights: FloatArray, terms: FloatArray) -> float:
    """Return the displacement after the last drive."""
    return displacement(weights, memory.now) + displacement_beside(memory, terms)


class SurfaceKernel:
    """Kernel of the compensator for a surface, on a memory of drives.

    Args:
        form: Form of the surface.
        weights: (24,) coefficients in use; they change in place.
        creep: Creep so far, and the displacement; its lags change in place.
    """

    def __init__(self, form: SurfaceForm, weights: FloatArray, creep: CreepState) -> None:
        self._memory, self._weights, self._terms = new_surface_memory(), weights, form.terms
        self.carried: FloatArray = np.zeros(CARRIED)
        if creep.memory is not None:
            assign_memory(self._memory, creep.memory)
            drive = float(self._memory.last[RAW])
        else:  # the stage rests: it does not lag
            drive = drive_for(self._memory, weights, form.slow.terms, creep.quick)
        self.carried[[COMMAND, NEXT, POSITION]] = creep.shown, drive, creep.quick
        self.carried[CREPT] = float(creep.creep.weights @ creep.lags)
        # Bound once, as in `StopKernel`.
        self.step: Callable[
            [FloatArray, float, float, float, float, float, float, float], float
        ] = partial(
            step,
            *self._memory,
            self.carried,
            self._terms,
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
        self.carried[NEXT] = np.nan
        position = _position(self._memory, self._weights, self._terms)
        if isfinite(position):
            self.carried[POSITION] = position
