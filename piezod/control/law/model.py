"""The identified model of a stage: hysteresis, ranges, creep and delay."""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.first_mode import FirstModeConfig
from piezod.control.law.creep import NO_CREEP, CreepLaw, CreepState
from piezod.control.law.first_mode import FirstMode
from piezod.control.law.held_delay import delay_at
from piezod.errors import DataError
from piezod.hysteresis import AffineRange, ModelForm, StopForm
from piezod.hysteresis.memory import FloatArray

AnyAxisConfig = TypeVar("AnyAxisConfig", bound=AxisConfig)

REST_BEYOND = 0.01
"""The rest voltage may be outside the model's voltages by this share of their range. If it is
further inside, the displacement there depends on where the voltage has been."""
RELAXING_SWINGS = 12
"""Swings that end in the relaxed state of a stage that rests inside its range."""


@dataclass(frozen=True)
class StageModel:
    """An identified model of hysteresis, with the ranges, the creep and the delay."""

    form: ModelForm  #: Form of the model of hysteresis.
    weights: FloatArray  #: (form.size,) weights of the form.
    drive_v: AffineRange  #: Range of the drive that is [0, 1], paper eq. (28), in V.
    position_um: AffineRange  #: Range of the displacement without creep that is [0, 1], in µm.
    #: Delay of the displacement behind the voltage, in s, where each is held for `held_s`.
    delay_s: float
    creep: CreepLaw = NO_CREEP  #: Creep, which adds to the displacement of the hysteresis.
    #: First mode, if the data showed one; the loop uses it if its configuration has none.
    mode: FirstMode | None = None
    error_um: float = 0.0  #: Worst error of a position in the identification, in µm; 0 if unknown.
    #: Time for which the drive holds each voltage, in s; None if that of the identification is
    #: unknown.
    held_s: float | None = None

    def at(self, period_s: float) -> "StageModel":
        """Return the model for a loop that holds each voltage for one period, in s."""
        held_s = period_s if self.held_s is None else self.held_s
        delay_s = delay_at(self.delay_s, held_s, period_s)
        return replace(self, form=self.form.sampled(period_s), delay_s=delay_s, held_s=period_s)

    def zeroed_at(self, rest_v: float) -> "StageModel":
        """Return the model with the displacement at rest as zero.

        A stage is zeroed at rest before it is driven. Recorded data may have another zero.

        Raises:
            DataError: If the model does not hold at the rest voltage.
        """
        rest = self.drive_v.to_unit(rest_v)
        if not -REST_BEYOND <= rest <= 1.0 + REST_BEYOND:
            raise DataError(
                f"the model holds from {self.drive_v.low:g} to {self.drive_v.high:g} V, but the "
                f"rest voltage is {rest_v:g} V; identify with a drive that starts at rest"
            )
        rest_um = self.position_um.from_unit(self.at_rest(rest_v, 1.0).quick)
        low, high = self.position_um
        return replace(self, position_um=AffineRange(low - rest_um, high - rest_um))

    def zeroed_from_below(self, rest_v: float) -> "StageModel":
        """Return the model with zero at rest as it is after a rise from its lowest voltage."""
        rest_um = self._rising_um(self.drive_v.to_unit(rest_v))
        low, high = self.position_um
        return replace(self, position_um=AffineRange(low - rest_um, high - rest_um))

    def rests_inside(self, rest_v: float) -> bool:
        """Return whether the displacement at rest depends on where the voltage has been."""
        return REST_BEYOND < self.drive_v.to_unit(rest_v) < 1.0 - REST_BEYOND

    def at_rest(self, rest_v: float, period_s: float) -> CreepState:
        """Return the state of a stage after a long rest, with a relaxed hysteresis.

        At an end of the range that is the end itself. Inside, it is where swings end that become
        smaller and smaller, as those of `condition`: the next rise and the next fall are alike.

        Args:
            rest_v: The rest voltage, in V.
            period_s: Period of the loop, in s.
        """
        past, rest = self.form.slow.past(self.weights), self.drive_v.to_unit(rest_v)
        drives = np.array([rest])
        if self.rests_inside(rest_v):
            left = np.linspace(1.0, 0.0, RELAXING_SWINGS)
            drives = np.column_stack((rest + left * (1.0 - rest), rest - left * rest)).ravel()
        quick = past.follow(drives)
        lags = np.full(self.creep.weights.size, quick)
        zeroed = float(self.creep.weights @ lags)
        return CreepState(self.creep.at(period_s), lags, zeroed, quick, past.memory)

    def reach_um(self, low_v: float, high_v: float) -> tuple[float, float]:
        """Return the lowest and the highest position that commands can reach, in µm.

        The model holds in its own range only, so no drive beyond that is asked for.

        Args:
            low_v: Lowest allowed voltage, in V.
            high_v: Highest allowed voltage, in V.
        """
        low, high = (self._rising_um(self.drive_v.to_unit(drive_v)) for drive_v in (low_v, high_v))
        return low, high

    def _rising_um(self, drive: float) -> float:
        """Return the position at a drive on its first rise over the whole range, in µm."""
        x = np.linspace(0.0, 1.0, 2001)
        # These are drives for positions: interpolate backwards. np.interp needs drives that do not
        # fall.
        rising, _ = self.form.widest_loop(self.weights, x)
        z = np.maximum.accumulate(rising)
        return self.position_um.from_unit(float(np.interp(drive, z, x)))


def with_found_mode(config: AnyAxisConfig, model: StageModel | None) -> AnyAxisConfig:
    """Return the configuration of an axis, with the first mode of its model if it has none.

    Args:
        config: Configuration of the axis; a response is better than the mode of a model.
        model: Model of the axis, if it has one.
    """
    if config.first_mode or config.response or model is None or model.mode is None:
        return config
    mode = FirstModeConfig(frequency_hz=model.mode.frequency_hz, damping=model.mode.damping)
    return config.model_copy(update={"first_mode": mode})


def unidentified_form(config: AxisConfig) -> ModelForm:
    """Return the form for an axis that has no model yet: evenly spaced stops."""
    return StopForm.even(config.compensator.operators)
