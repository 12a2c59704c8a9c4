"""An input of a device: its sample converted to µm, by its calibration and its light."""

from collections.abc import Sequence
from math import isfinite

from piezod.config.channels import Calibration, LightConfig
from piezod.devices.calibration import curve_of
from piezod.devices.interface import Sample, Wiring


class CalibratedInput:
    """Converts the value of an input to µm.

    Args:
        wiring: Channels of the device.
        channel: Name of the input.
        calibration: Calibration from its value to µm.
        light: Channel of its light; None if there is none.
    """

    def __init__(
        self, wiring: Wiring, channel: str, calibration: Calibration, light: LightConfig | None
    ) -> None:
        self._place = wiring.inputs.index(channel)
        self._curve = curve_of(calibration)
        self._light = light
        self._light_place = -1 if light is None else wiring.inputs.index(light.channel)
        self.low_light = False
        """Whether the light of the last sample was too low."""

    @property
    def plain_place(self) -> int | None:
        """Index of its sample among those of the device if no conversion is needed, else None."""
        return self._place if self._curve is None and self._light is None else None

    @property
    def needs_light(self) -> bool:
        """Whether a sample needs enough light to be valid."""
        return self._light is not None

    def sample(self, raw: Sequence[Sample]) -> Sample:
        """Return its sample in µm. Real-time safe.

        It is invalid outside the range of the calibration, or if the light is too low.

        Args:
            raw: One sample of each input of the device, in the units of the device.
        """
        t_ns, value, valid = raw[self._place]
        if self._light is not None:
            value *= self._per_light(self._light, raw[self._light_place])
        position_um = value if self._curve is None else self._curve.physical(value)
        return Sample(t_ns, position_um, valid and not self.low_light and isfinite(position_um))

    def _per_light(self, light: LightConfig, light_sample: Sample) -> float:
        """Return the factor by which the value is corrected for its light; NaN if it is too low."""
        level = light_sample.position_um  # before calibration the field holds the raw value
        enough = light_sample.valid and level > 0.0 and level >= light.least
        # An invalid light sample is not reported as low light: the device reports its own fault.
        self.low_light = light_sample.valid and not enough
        if not enough:
            return float("nan")
        # The signal of a fibre sensor grows with its light; the quotient of both does not.
        return light.nominal / level if light.divides else 1.0
