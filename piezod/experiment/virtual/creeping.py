"""What a stage carries from run to run: its creep, and where its drive has been."""

import numpy as np

from piezod.control.law.creep import CreepState
from piezod.control.law.model import StageModel
from piezod.hysteresis.creep import remove_creep
from piezod.hysteresis.memory import MERGED, FloatArray, copy_memory


class Creeping:
    """The creep of one axis, from its measured positions, and its hysteresis, from its voltages.

    Args:
        model: Model of the axis, with its zero at rest.
        rest_v: Voltage at rest, in V.
        period_s: Sample period, in s.
    """

    def __init__(self, model: StageModel, rest_v: float, period_s: float) -> None:
        state = model.at_rest(rest_v, period_s)
        self._position_um, self._drive_v = model.position_um, model.drive_v
        self._rest = model.position_um.to_unit(0.0)
        self._creep, self._lags, self._quick = state.creep, state.lags, state.quick
        self._past = model.form.sampled(period_s).past(model.weights)
        if state.memory is not None:
            self._past.take_over(state.memory)
        self._driven = self._quick
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

    def follow(self, drive_v: FloatArray) -> None:
        """Follow voltages in force, shape (n,), in V."""
        self._driven = self._past.follow(self._drive_v.to_unit(drive_v))

    def zero(self) -> None:
        """Take the present displacement as zero: the stage rests, and its sensor was zeroed."""
        self._quick = self._driven
        self._zeroed = float(self._creep.weights @ self._lags) + self._driven - self._rest

    @property
    def state(self) -> CreepState:
        """Present state of creep and hysteresis."""
        memory = copy_memory(self._past.memory)
        memory.counts[MERGED] = 0
        return CreepState(self._creep, self._lags, self._zeroed, self._quick, memory)
