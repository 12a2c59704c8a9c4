"""The creep of a stage, in seconds: its law and its present state."""

from typing import NamedTuple

import numpy as np

from piezod.hysteresis.creep import NO_CREEP as NO_LAGS
from piezod.hysteresis.creep import Creep
from piezod.hysteresis.memory import FloatArray, Memory

LAGS_PER_DECADE = 2
TIME_CONSTANTS_S: FloatArray = 10.0 ** (np.arange(8) / LAGS_PER_DECADE - 1.5)
"""Time constants from 0.03 to 100 s. Faster creep is part of the hysteresis, slower creep is part
of the drift."""


class CreepLaw(NamedTuple):
    """Creep as first-order lags that follow the displacement without creep."""

    time_constants_s: FloatArray  #: (K,) time constants, in s.
    #: (K,) contribution of each lag, as a share of the displacement that it follows.
    weights: FloatArray

    @property
    def per_decade(self) -> float:
        """Creep after a step, per decade of time, as a share of the step."""
        return LAGS_PER_DECADE * float(np.mean(self.weights)) if self.weights.size else 0.0

    def at(self, period_s: float) -> Creep:
        """Return the lags for samples of this period, in s."""
        return Creep(self.weights, -np.expm1(-period_s / self.time_constants_s))


NO_CREEP = CreepLaw(np.empty(0), np.empty(0))


def logarithmic(weight: float) -> CreepLaw:
    """Return creep that grows with the logarithm of time, as that of piezo ceramics does.

    Args:
        weight: Contribution of each lag, as a share of the displacement that it follows.
    """
    return CreepLaw(TIME_CONSTANTS_S, np.full(TIME_CONSTANTS_S.size, weight))


class CreepState(NamedTuple):
    """State of a stage, for a law that starts; displacements are in units of the range."""

    creep: Creep  #: Law of the creep at the period of the loop.
    lags: FloatArray  #: (K,) state of the lags.
    #: Creep, and distance of the hysteresis from its relaxed state, when the sensor was zeroed: it
    #: does not show them.
    zeroed: float
    quick: float  #: Displacement without creep.
    #: Memory of the hysteresis, which ends there; None if the drive has only risen to it.
    memory: Memory | None = None

    @property
    def shown(self) -> float:
        """Displacement that the sensor shows."""
        return self.quick + float(self.creep.weights @ self.lags) - self.zeroed


AT_REST = CreepState(NO_LAGS, np.empty(0), 0.0, 0.0)
"""State of a stage without creep, at the lower end of its range."""
