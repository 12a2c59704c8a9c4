"""How far a stage has crept: what a compensator and an identifier start from."""

from typing import NamedTuple

import numpy as np

from piezod.hysteresis.creep import NO_CREEP, Creep
from piezod.hysteresis.memory import FloatArray


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


AT_REST = CreepState(NO_CREEP, np.empty(0), 0.0, 0.0)
"""Of a stage that does not creep, at the lower end of its range."""
