"""Creep in seconds: how much, over which times, and how far a stage has crept."""

from typing import NamedTuple

import numpy as np

from piezod.hysteresis.creep import NO_CREEP as NO_LAGS
from piezod.hysteresis.creep import Creep
from piezod.hysteresis.memory import FloatArray

LAGS_PER_DECADE = 2
TIME_CONSTANTS_S: FloatArray = 10.0 ** (np.arange(8) / LAGS_PER_DECADE - 1.5)
"""From 0.03 to 100 s. Faster creep is a part of the hysteresis, slower creep one of the drift."""


class CreepLaw(NamedTuple):
    """Creep as first-order lags that follow the quick displacement.

    Attributes:
        time_constants_s: (K,) time constants, in s.
        weights: (K,) what each lag adds, as a share of what it follows.
    """

    time_constants_s: FloatArray
    weights: FloatArray

    @property
    def per_decade(self) -> float:
        """Creep after a step per decade of time, as a share of the step."""
        return LAGS_PER_DECADE * float(np.mean(self.weights)) if self.weights.size else 0.0

    def at(self, period_s: float) -> Creep:
        """Return the lags for samples that are this far apart, in s."""
        return Creep(self.weights, -np.expm1(-period_s / self.time_constants_s))


NO_CREEP = CreepLaw(np.empty(0), np.empty(0))


def logarithmic(weight: float) -> CreepLaw:
    """Return creep that goes on with the logarithm of time, as that of piezo ceramics does.

    Args:
        weight: What each lag adds, as a share of what it follows.
    """
    return CreepLaw(TIME_CONSTANTS_S, np.full(TIME_CONSTANTS_S.size, weight))


class CreepState(NamedTuple):
    """The creep of a stage at an instant; displacements in units of the range.

    Attributes:
        creep: How the stage creeps.
        lags: (K,) its lags.
        zeroed: What had crept when the sensor was zeroed, and is not seen of it since.
        quick: Displacement without creep.
    """

    creep: Creep
    lags: FloatArray
    zeroed: float
    quick: float


AT_REST = CreepState(NO_LAGS, np.empty(0), 0.0, 0.0)
"""Of a stage that does not creep, at the lower end of its range."""
