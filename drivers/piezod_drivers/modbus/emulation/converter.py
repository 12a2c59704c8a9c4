"""Converters on the rig: an output drives an amplifier, an input measures a sensor's voltage."""

from collections.abc import Callable
from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod_drivers.modbus.emulation.unit import DEVICE_FAILURE, ILLEGAL_VALUE, ModbusRefusal

FULL_V: Final = 150.0
"""Voltage of the amplifier behind an output at the end of the output's range."""
OVERLOAD_V: Final = 1000.0
"""Voltage at an input that is far beyond its range."""


class ConverterOutput:
    """A digital-to-analogue converter, with an amplifier behind it if the rig has the axis.

    Args:
        axis: Index of the axis.
        highest: Highest value, in V or mA.
        n_codes: Number of steps of the converter.
        lowest: Lowest value, in V or mA.
    """

    def __init__(
        self, bench: SharedRig, axis: int, highest: float, n_codes: int, lowest: float = 0.0
    ) -> None:
        self._bench, self._axis, self._n_codes = bench, axis, n_codes
        self._lowest, self._highest = lowest, highest
        self.value = 0.0

    def set(self, value: float, at_ns: int | None = None) -> None:
        """Set the output; a value beyond the range is limited to it.

        Args:
            value: The value.
            at_ns: The instant; None for now.

        Raises:
            ModbusRefusal: If it is not a number, or the amplifier refuses it.
        """
        if not isfinite(value):
            raise ModbusRefusal(ILLEGAL_VALUE)
        span = self._highest - self._lowest
        part = min(max((value - self._lowest) / span, 0.0), 1.0)
        # The steps of the converter.
        value = self._lowest + round(part * self._n_codes) / self._n_codes * span
        drive_v = value / self._highest * FULL_V
        if self._axis < self._bench.n_axes and not self._bench.drive(self._axis, drive_v, at_ns):
            raise ModbusRefusal(DEVICE_FAILURE)
        self.value = value

    def set_code(self, scale: float, offset: float = 0.0) -> Callable[[float], None]:
        """Return a function that sets the output to a code: value = scale · code + offset."""
        return lambda code: self.set(code * scale + offset)


def measured_v(bench: SharedRig, axis: int) -> float:
    """Return the voltage at an input; 0 V if nothing is connected."""
    if axis >= bench.n_axes:
        return 0.0
    value_v = bench.conditioned_v(axis)
    # A sensor without signal counts as far out of range, so that the device reports it as
    # saturated.
    return value_v if isfinite(value_v) else OVERLOAD_V
