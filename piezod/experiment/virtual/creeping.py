"""The creep of a stage, followed from run to run."""

import numpy as np

from piezod.control.law.creep import CreepState
from piezod.control.law.model import StageModel
from piezod.hysteresis.creep import remove_creep
from piezod.hysteresis.memory import FloatArray


class Creeping:
    """The creep of one axis, from its measured positions.

    Args:
        model: Model of the axis, with its zero at rest.
        period_s: Sample period, in s.
    """

    def __init__(self, model: StageModel, period_s: float) -> None:
        self._position_um = model.position_um
        self._creep = model.creep.at(period_s)
        self._rest = self._quick = model.position_um.to_unit(0.0)
        self._lags = np.full(model.creep.weights.size, self._rest)
        self._zeroed = 0.0
        self.zero()

    def watch(self, position_um: FloatArray) -> None:
        """Follow measured positions, shape (n,), in µm; NaN for missing samples."""
        known = np.flatnonzero(np.isfinite(position_um))
        if not self._lags.size or not known.size:
            return
        # A missing sample counts as the last one before it; the first ones count as the first
        # sample.
        held = np.maximum.accumulate(
            np.where(np.isfinite(position_um), np.arange(position_um.size), known[0])
        )
        x = self._position_um.to_unit(position_um[held]) + self._zeroed
        self._quick = float(remove_creep(self._creep, x, self._lags, self._quick)[-1])

    def zero(self) -> None:
        """Take the present displacement as zero: the stage rests, and its sensor was zeroed."""
        self._zeroed = float(self._creep.weights @ self._lags)
        self._quick = self._rest

    @property
    def state(self) -> CreepState:
        """Present state of the creep."""
        return CreepState(self._creep, self._lags, self._zeroed, self._quick)
