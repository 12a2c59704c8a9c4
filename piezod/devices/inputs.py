"""An input of a device: its sample made µm, by its calibration and by the light it has."""

from collections.abc import Sequence
from math import isfinite

from piezod.config.channels import Calibration, LightConfig
from piezod.devices.calibration import curve_of
from piezod.devices.interface import Sample, Wiring


class CalibratedInput:
    """Makes µm of what a device reads.

    Args:
        wiring: The channels of the device.
        channel: Name of the input.
        calibration: From its value to µm.
        light: Where its light is told; None where it is not.
    """

    def __init__(
        self, wiring: Wiring, channel: str, calibration: Calibration, light: LightConfig | None
    ) -> None:
        self._place = wiring.inputs.index(channel)
        self._curve = curve_of(calibration)
        self._light = light
        self._light_place = -1 if light is None else wiring.inputs.index(light.channel)
        self.low_light = False
        """Whether there was not enough light for the last sample."""

    @property
    def plain_place(self) -> int | None:
        """Where its sample stands among those of the device, if that need not be changed."""
        return self._place if self._curve is None and self._light is None else None

    @property
    def needs_light(self) -> bool:
        """Whether it has to have light."""
        return self._light is not None

    def sample(self, taken: Sequence[Sample]) -> Sample:
        """Return its sample in µm; may be called in the loop.

        It is not valid where the calibration does not hold, or the light is not enough.

        Args:
            taken: One sample of each input of the device.
        """
        t_ns, value, valid = taken[self._place]
        if self._light is not None:
            value *= self._per_light(self._light, taken[self._light_place])
        position_um = value if self._curve is None else self._curve.physical(value)
        return Sample(t_ns, position_um, valid and not self.low_light and isfinite(position_um))

    def _per_light(self, light: LightConfig, told: Sample) -> float:
        level = told.position_um
        enough = told.valid and level > 0.0 and level >= light.least
        # A light that is not told is not said to be low: the device says what is the matter.
        self.low_light = told.valid and not enough
        if not enough:
            return float("nan")
        return light.nominal / level if light.divides else 1.0
