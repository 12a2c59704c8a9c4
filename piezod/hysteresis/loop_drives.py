"""Drives that a learned model requests along one loop, again and again. Real-time safe.

A learned model shifts and stretches the displacement x before it inverts the hysteresis:
y = (1 + scale) x - offset. The arrays are made once, so that nothing is allocated later.
"""

from functools import partial
from typing import Protocol

import numpy as np

from piezod.hysteresis.adaptation import Adaptable
from piezod.hysteresis.bank import advance_plays, new_bank_memory, weighted_sum
from piezod.hysteresis.everett_memory import invert_record, new_surface_memory, relax_surface
from piezod.hysteresis.memory import FloatArray, IntArray, Memory, relax, relax_within
from piezod.jit import compiled

_CAPACITY = 4
"""Extrema stored on each side; one loop has fewer."""


class LoopDrives(Protocol):
    """The drives at displacements that rise once and fall once, from the relaxed state on."""

    def of(self, model: Adaptable) -> FloatArray:
        """Return the drives of a model, shape (n,), in an array that the next call overwrites."""


class StopLoop:
    """The drives of a sum of stops.

    Args:
        bank: (2, 2 M) thresholds and gains of the stops.
        positions: (n,) displacements that rise once and fall once.
    """

    def __init__(self, bank: FloatArray, positions: FloatArray) -> None:
        self._drives = np.empty_like(positions)
        self._fill = partial(
            _fill_stop_drives, *new_bank_memory(bank, _CAPACITY), bank, positions, self._drives
        )

    def of(self, model: Adaptable) -> FloatArray:
        """Return the drives of a model, shape (n,), in an array that the next call overwrites."""
        self._fill(model.weights, model.offset, model.scale)
        return self._drives


# One call in place of many of numpy: the loop asks 50 times a second.
@compiled
def _fill_stop_drives(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    positions: FloatArray,
    drives: FloatArray,
    weights: FloatArray,
    offset: float,
    scale: float,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    relax_within(memory)
    for k in range(positions.size):
        # The memory clamps its input.
        value = advance_plays(memory, bank, 0.0, (1.0 + scale) * positions[k] - offset)
        drives[k] = weighted_sum(now, bank, weights, value)


class SurfaceLoop:
    """The drives of a surface.

    Args:
        terms: (8,) constants of the optional terms, without lag.
        positions: (n,) displacements that rise once and fall once.
        beyond: Distance outside [0, 1] that an input may reach.
    """

    def __init__(self, terms: FloatArray, positions: FloatArray, beyond: float) -> None:
        self._terms, self._positions, self._beyond = terms, positions, beyond
        self._memory = new_surface_memory(_CAPACITY)
        self._inputs, self._drives = np.empty_like(positions), np.empty_like(positions)

    def of(self, model: Adaptable) -> FloatArray:
        """Return the drives of a model, shape (n,), in an array that the next call overwrites."""
        _put_inputs(model, self._positions, self._beyond, self._inputs)
        relax(self._memory)
        relax_surface(self._memory)
        invert_record(self._memory, model.weights, self._terms, 0.0, self._inputs, self._drives)
        return self._drives


def _put_inputs(model: Adaptable, positions: FloatArray, beyond: float, inputs: FloatArray) -> None:
    """Write the inputs y of the hysteresis, shape (n,), for displacements, shape (n,)."""
    np.multiply(positions, 1.0 + model.scale, out=inputs)
    np.subtract(inputs, model.offset, out=inputs)
    np.maximum(inputs, -beyond, out=inputs)
    np.minimum(inputs, 1.0 + beyond, out=inputs)
