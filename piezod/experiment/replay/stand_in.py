"""What a stage would have done at another voltage: what it did, plus what a model says differs.

With F, a model of the stage, u the recorded and u' the other voltage, one delay before the sample:

    x' = x + F(u') - F(u)

With the same voltage this is exactly the record, with its noise, creep and drift. The error of F
counts only for the difference of the voltages. F has the hysteresis and the creep of the model, and
not its first mode.
"""

import numpy as np

from piezod.control.law.model import StageModel
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.memory import FloatArray


class StandIn:
    """Stands in for a stage at voltages that differ from the recorded ones.

    Args:
        model: Model of the stage.
        in_force_v: (n,) recorded voltages in force, in V.
        period_s: Period of the loop, in s.
    """

    def __init__(self, model: StageModel, in_force_v: FloatArray, period_s: float) -> None:
        self._drive_v, self._width_um = model.drive_v, model.position_um.width
        self._delay_cycles = model.delay_s / period_s
        form = model.form.sampled(period_s)
        self._stage = form.stage(model.weights)
        self._other_v = np.empty_like(in_force_v)
        cycles = np.arange(in_force_v.size)
        delayed_v = np.interp(cycles - self._delay_cycles, cycles, in_force_v)
        drives = np.clip(model.drive_v.to_unit(delayed_v), 0.0, 1.0)
        self._recorded = form.positions_at(model.weights, drives)
        # Creep is linear: that of the difference is the difference of both.
        self._creep, self._lags = model.creep.at(period_s), np.zeros(model.creep.weights.size)
        self._moved = 0.0

    def moved_um(self, cycle: int, in_force_v: float) -> float:
        """Return how much further the stage is than recorded, in µm. Call once per cycle, in order.

        Args:
            cycle: Number of the cycle, from 0.
            in_force_v: Voltage in force in this cycle, in V.
        """
        self._other_v[cycle] = in_force_v
        place = max(cycle - self._delay_cycles, 0.0)
        before = int(place)
        after = min(before + 1, cycle)
        share = place - before
        delayed_v = self._other_v[before] + share * (self._other_v[after] - self._other_v[before])
        drive = min(max(self._drive_v.to_unit(float(delayed_v)), 0.0), 1.0)
        crept = advance_creep(self._lags, self._creep.gains, self._creep.weights, self._moved)
        self._moved = self._stage.step(drive) - float(self._recorded[cycle])
        return (self._moved + crept) * self._width_um
