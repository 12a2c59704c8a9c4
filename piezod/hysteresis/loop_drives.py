"""Drives that a learned model requests along one loop, again and again. Real-time safe.

A learned model shifts and stretches the displacement x before it inverts the hysteresis:
y = (1 + scale) x - offset. The arrays are made once, so that nothing is allocated later.
"""

from typing import Protocol

import numpy as np

from piezod.hysteresis.adaptation import Adaptable
from piezod.hysteresis.bank import new_bank_memory
from piezod.hysteresis.everett_memory import invert_record, new_surface_memory, relax_surface
from piezod.hysteresis.least_squares import fill_regressors
from piezod.hysteresis.memory import FloatArray, relax

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
        self._bank, self._positions = bank, positions
        self._memory = new_bank_memory(bank, _CAPACITY)
        self._inputs, self._drives = np.empty_like(positions), np.empty_like(positions)
        self._regressors = np.empty((positions.size, bank.shape[1]))

    def of(self, model: Adaptable) -> FloatArray:
        """Return the drives of a model, shape (n,), in an array that the next call overwrites."""
        inputs, drives = self._inputs, self._drives
        _put_inputs(model, self._positions, 0.0, inputs)
        relax(self._memory)
        fill_regressors(*self._memory, self._bank, 0.0, inputs, self._regressors)
        np.dot(self._regressors, model.weights, out=drives)
        drives += inputs
        return drives


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
