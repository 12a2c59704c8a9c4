"""The identified model of a stage: hysteresis, ranges, creep and delay."""

from dataclasses import dataclass, replace

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.control.law.creep import NO_CREEP, CreepLaw
from piezod.control.law.first_mode import FirstMode
from piezod.errors import DataError
from piezod.hysteresis import AffineRange, ModelForm, StopForm
from piezod.hysteresis.memory import FloatArray

REST_BEYOND = 0.01
"""The rest voltage may be outside the model's voltages by this share of their range."""


@dataclass(frozen=True)
class StageModel:
    """An identified model of hysteresis, with the ranges, the creep and the delay.

    Attributes:
        form: Form of the model of hysteresis.
        weights: (form.size,) weights of the form.
        drive_v: Range of the drive that is [0, 1], paper eq. (28), in V.
        position_um: Range of the displacement without creep that is [0, 1], in µm.
        delay_s: Delay of the displacement behind the voltage, in s.
        creep: Creep, which adds to the displacement of the hysteresis.
        mode: First mode, if the data showed one; the loop uses that of its configuration.
    """

    form: ModelForm
    weights: FloatArray
    drive_v: AffineRange
    position_um: AffineRange
    delay_s: float
    creep: CreepLaw = NO_CREEP
    mode: FirstMode | None = None

    def zeroed_at(self, rest_v: float) -> "StageModel":
        """Return the model with the displacement at rest as zero.

        A stage is zeroed at rest before it is driven. Recorded data may have another zero.

        Args:
            rest_v: Voltage at rest, in V.

        Raises:
            DataError: If the model does not hold at the rest voltage.
        """
        rest = self.drive_v.to_unit(rest_v)
        if not -REST_BEYOND <= rest <= 1.0 + REST_BEYOND:
            raise DataError(
                f"the model holds from {self.drive_v.low:g} to {self.drive_v.high:g} V, but the "
                f"rest voltage is {rest_v:g} V; identify with a drive that starts at rest"
            )
        x = np.linspace(0.0, 1.0, 2001)
        # These are drives for positions: interpolate backwards. np.interp needs drives that do not
        # fall.
        rising, _ = self.form.widest_loop(self.weights, x)
        z = np.maximum.accumulate(rising)
        rest_um = self.position_um.from_unit(float(np.interp(rest, z, x)))
        low, high = self.position_um
        return replace(self, position_um=AffineRange(low - rest_um, high - rest_um))


def unidentified_form(config: AxisConfig) -> ModelForm:
    """Return the form for an axis that has no model yet: evenly spaced stops."""
    return StopForm.even(config.compensator.operators)
