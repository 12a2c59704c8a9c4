"""What the drives of a stage have left in its memory, for a model that starts later.

A compensator and an identifier keep a memory of their own. One that starts later takes over the
memory of what was driven before: without it, a stage that rests inside its range, and not at an
end, is elsewhere than the model expects.
"""

from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np

from piezod.hysteresis.bank import advance_plays, new_bank_memory, position_for
from piezod.hysteresis.everett_memory import (
    advance_drive,
    displacement,
    displacement_beside,
    new_surface_memory,
)
from piezod.hysteresis.memory import FloatArray, IntArray, Memory, assign_memory
from piezod.jit import compiled


class Past(Protocol):
    """A stage without creep, followed drive by drive."""

    @property
    def memory(self) -> Memory:
        """Memory, for a compensator or an identifier of the same form; it changes in place."""

    def follow(self, drives: FloatArray, /) -> float:
        """Follow drives in [0, 1], shape (n,); return the displacement after the last one.

        Real-time safe.
        """

    def step(self, drive: float, /) -> float:
        """Follow one drive in [0, 1]; return the displacement. Real-time safe, each cycle."""

    def take_over(self, memory: Memory) -> None:
        """Go on from another memory of the same form."""


class StopPast:
    """The past of a sum of stops: a memory of displacements.

    Args:
        bank: (2, 2 M) thresholds and gains of the stops, from `new_bank`.
        weights: (2 M,) weights [a^l, a^r] of a model that can be inverted; they may change.
    """

    def __init__(self, bank: FloatArray, weights: FloatArray) -> None:
        self.memory = new_bank_memory(bank)
        fixed = bank, np.empty(bank.shape[1]), weights
        # Bound once: a partial function adds no Python frame.
        self.follow: Callable[[FloatArray], float] = partial(_follow_stops, self.memory, *fixed)
        self.step: Callable[[float], float] = partial(_step_stops, *self.memory, *fixed)

    def take_over(self, memory: Memory) -> None:
        """Go on from another memory of the same form."""
        assign_memory(self.memory, memory)


class SurfacePast:
    """The past of a surface: a memory of drives.

    Args:
        coefficients: (24,) coefficients; they may change.
        terms: (8,) constants of the optional terms, from `SurfaceForm.terms`.
    """

    def __init__(self, coefficients: FloatArray, terms: FloatArray) -> None:
        self.memory = new_surface_memory()
        self.follow: Callable[[FloatArray], float] = partial(
            _follow_surface, self.memory, coefficients, terms
        )
        self.step: Callable[[float], float] = partial(
            _step_surface, *self.memory, coefficients, terms
        )

    def take_over(self, memory: Memory) -> None:
        """Go on from another memory of the same form."""
        assign_memory(self.memory, memory)


@compiled
def _follow_stops(
    memory: Memory, bank: FloatArray, plays: FloatArray, weights: FloatArray, drives: FloatArray
) -> float:
    position = 0.0
    for k in range(drives.size):
        position = position_for(memory, bank, plays, weights, drives[k])
        advance_plays(memory, bank, 0.0, position)
    return position


@compiled
def _follow_surface(
    memory: Memory, coefficients: FloatArray, terms: FloatArray, drives: FloatArray
) -> float:
    for k in range(drives.size):
        advance_drive(memory, terms, 0.0, drives[k])
    return displacement(coefficients, memory.now) + displacement_beside(memory, terms)


# The fields of the tuple are passed one by one, see decision 3.
@compiled
def _step_stops(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    plays: FloatArray,
    weights: FloatArray,
    drive: float,
) -> float:
    memory = Memory(levels, values, now, last, counts)
    position = position_for(memory, bank, plays, weights, drive)
    advance_plays(memory, bank, 0.0, position)
    return position


@compiled
def _step_surface(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    coefficients: FloatArray,
    terms: FloatArray,
    drive: float,
) -> float:
    memory = Memory(levels, values, now, last, counts)
    advance_drive(memory, terms, 0.0, drive)
    return displacement(coefficients, now) + displacement_beside(memory, terms)
