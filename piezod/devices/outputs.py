"""An output of a device: what it is set to made of V at the actuator, by its calibration."""

from math import inf
from typing import Final

from piezod.config.channels import Calibration
from piezod.devices.calibration import curve_of

SLACK_V: Final = 1e-6
"""Calibrations round: what is beyond the reach of an output by no more is taken for its end."""
ANY_VALUE: Final = -inf, inf


class CalibratedOutput:
    """Makes of V at the actuator what a device is set to, and V of what it tells.

    Args:
        calibration: From its value to V.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._curve = curve_of(calibration)
        self.range = ANY_VALUE
        """Lowest and highest value that it can be set to, as the device tells."""

    def reach_v(self) -> tuple[float, float]:
        """Tell the lowest and the highest voltage that it can give."""
        if self.range == ANY_VALUE:
            return ANY_VALUE
        low_v, high_v = sorted(map(self.voltage, self.range))
        return low_v, high_v

    def reaches(self, drive_v: float) -> bool:
        """Tell whether it can give a voltage, or one that is as good as that."""
        low_v, high_v = self.reach_v()
        return low_v - SLACK_V <= drive_v <= high_v + SLACK_V

    def value(self, drive_v: float) -> float:
        """Return what it is set to for a voltage; may be called in the loop.

        It is beyond its range, or NaN, where the voltage cannot be had.
        """
        value = drive_v if self._curve is None else self._curve.value(drive_v)
        low, high = self.range
        if low <= value <= high:
            return value
        end = min(max(value, low), high)
        end_v = self.voltage(end)
        return end if end_v - SLACK_V <= drive_v <= end_v + SLACK_V else value

    def voltage(self, value: float) -> float:
        """Return the voltage at a value, wherever it is; may be called in the loop."""
        return value if self._curve is None else self._curve.beyond(value)
