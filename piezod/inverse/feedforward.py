"""The inverse of an axis step by step, as mode `feedforward` of the loop computes it."""

from math import nan

import numpy as np

from piezod.config.drive_limits import DriveLimit
from piezod.config.modes import Mode
from piezod.control.guard import Limits, Window, admit_within
from piezod.control.law.axis import what_limits
from piezod.control.law.compensator import Compensator
from piezod.control.law.creep import CreepState
from piezod.control.law.model import StageModel

_NO_COMMAND = nan
_ROUNDING = 1e-9
"""Rounding errors of normalised units."""


class Feedforward:
    """Turns positions into voltages, and follows voltages that something else has applied.

    Args:
        model: Model with its zero at rest, for loops of this period.
        limits: Limits of the drive.
        period_s: Period of the steps, in s.
        rest_v: Voltage in force at the start, at rest, in V.
        from_v: Voltage at which the stage has stood for long, after a move from rest, in V; None
            for a start at rest.
    """

    def __init__(
        self,
        model: StageModel,
        limits: Limits,
        period_s: float,
        rest_v: float,
        from_v: float | None = None,
    ) -> None:
        self._model, self._limits, self._period_s = model, limits, period_s
        self.in_force_v = rest_v if from_v is None else from_v
        """Voltage in force, in V."""
        self.state = model.at_rest(rest_v, period_s)
        """Creep and displacement at the start."""
        self._beyond = False
        if from_v is not None:
            self.state = _standing(model, self.state, from_v)
        self._compensator = Compensator(
            model.form, model.weights, mode=Mode.FEEDFORWARD, fade_cycles=1, creep=self.state
        )

    def step(self, position_um: float) -> float:
        """Return the voltage for the next position, within the limits, in V. Real-time safe.

        Args:
            position_um: Position, in µm; one out of reach counts as the nearest, NaN as the last.
        """
        window = self._limits.window(self.in_force_v, self._period_s)
        command = self._model.position_um.to_unit(position_um)
        self._beyond = command < -_ROUNDING or command > 1.0 + _ROUNDING
        return self._write(command, window)

    def force(self, drive_v: float) -> float:
        """Follow a voltage, in V; return it within the limits. Real-time safe."""
        window = self._limits.window(self.in_force_v, self._period_s)
        forced_v, self._beyond = admit_within(window, drive_v, self.in_force_v), False
        return self._write(_NO_COMMAND, (forced_v, forced_v))

    def _write(self, command: float, window: Window) -> float:
        drive_v, compensator = self._model.drive_v, self._compensator
        low, high = drive_v.to_unit(window[0]), drive_v.to_unit(window[1])
        drive = compensator.step(command, low, high, compensator.weights)
        self.in_force_v = admit_within(window, drive_v.from_unit(drive), self.in_force_v)
        return self.in_force_v

    @property
    def expected_um(self) -> float:
        """Position to which the voltage in force leads, in µm."""
        return self._model.position_um.from_unit(self._compensator.expected)

    @property
    def limited(self) -> DriveLimit:
        """What kept the last voltage from following its position."""
        found = what_limits(self._compensator, self._limits, self.in_force_v)
        return DriveLimit.RANGE if self._beyond and found is DriveLimit.NONE else found

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of turning points that a full memory has removed."""
        return self._compensator.merged_pairs


def _standing(model: StageModel, rest: CreepState, from_v: float) -> CreepState:
    """Return the state after a move from rest to a voltage and a long stay there."""
    past = model.form.slow.past(model.weights)
    if rest.memory is not None:
        past.take_over(rest.memory)
    drive = min(max(model.drive_v.to_unit(from_v), 0.0), 1.0)
    quick = past.follow(np.array([drive]))
    lags = np.full(rest.lags.size, quick)
    return rest._replace(quick=quick, lags=lags, memory=past.memory)
