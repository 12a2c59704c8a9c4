"""An output of a device: the voltage at the actuator converted to its value, by its calibration."""

from math import inf
from typing import Final

from piezod.config.channels import Calibration
from piezod.devices.calibration import curve_of

SLACK_V: Final = 1e-6
"""Tolerance for the rounding of calibrations: a voltage this far beyond the range is its end."""
ANY_VALUE: Final = -inf, inf


class CalibratedOutput:
    """Converts the voltage at the actuator to the value of an output, and back."""

    def __init__(self, calibration: Calibration) -> None:
        self._curve = curve_of(calibration)
        self.range = ANY_VALUE
        """Lowest and highest value that the device reports for this output."""
        self.takes_any_voltage = self._curve is None
        """Whether the value is the voltage itself, whatever it is."""

    def set_range(self, low: float, high: float) -> None:
        """Take the lowest and the highest value that the device reports for this output."""
        self.range = low, high
        self.takes_any_voltage = self._curve is None and self.range == ANY_VALUE

    def reach_v(self) -> tuple[float, float]:
        """Return the lowest and the highest possible voltage, in V."""
        if self.range == ANY_VALUE:
            return ANY_VALUE
        low_v, high_v = sorted(map(self.voltage, self.range))  # a calibration may fall
        return low_v, high_v

    def reaches(self, drive_v: float) -> bool:
        """Return whether the output can give a voltage, within `SLACK_V`."""
        low_v, high_v = self.reach_v()
        return low_v - SLACK_V <= drive_v <= high_v + SLACK_V

    def value(self, drive_v: float) -> float:
        """Return the value for a voltage at the actuator. Real-time safe.

        If the voltage is not possible, the value is out of range or NaN, so that the device refuses
        it.
        """
        value = drive_v if self._curve is None else self._curve.value(drive_v)
        low, high = self.range
        if low <= value <= high:
            return value
        # A voltage at an end of the range may be rounded to a value just beyond it.
        end = min(max(value, low), high)
        end_v = self.voltage(end)
        return end if end_v - SLACK_V <= drive_v <= end_v + SLACK_V else value

    def voltage(self, value: float) -> float:
        """Return the voltage at a value, also outside the calibration. Real-time safe."""
        return value if self._curve is None else self._curve.beyond(value)
