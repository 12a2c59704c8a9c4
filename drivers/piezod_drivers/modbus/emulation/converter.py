"""Converters on a bench: an output drives an amplifier, an input measures a sensor's voltage."""

from collections.abc import Callable
from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod_drivers.modbus.emulation.unit import FAILURE, NO_VALUE, ModbusRefusal

FULL_V: Final = 150.0
"""What the amplifier behind an output gives at the end of the output's range."""
OVERLOAD_V: Final = 1000.0
"""What an input measures that is far beyond its range."""


class ConverterOutput:
    """A digital-to-analogue converter, with an amplifier behind it if the bench has the axis.

    Args:
        bench: The bench.
        axis: Which of its axes.
        highest: Highest value, in V or mA; the lowest is 0.
        n_codes: Into how many steps it is divided.
    """

    def __init__(self, bench: SharedRig, axis: int, highest: float, n_codes: int) -> None:
        self._bench, self._axis, self._highest, self._n_codes = bench, axis, highest, n_codes
        self.value = 0.0

    def set(self, value: float) -> None:
        """Set it; what is beyond its range becomes the end of the range.

        Raises:
            ModbusRefusal: If it is no number, or the amplifier cannot give it.
        """
        if not isfinite(value):
            raise ModbusRefusal(NO_VALUE)
        part = min(max(value / self._highest, 0.0), 1.0)
        part = round(part * self._n_codes) / self._n_codes
        if self._axis < self._bench.n_axes and not self._bench.drive(self._axis, part * FULL_V):
            raise ModbusRefusal(FAILURE)
        self.value = part * self._highest

    def set_code(self, scale: float) -> Callable[[float], None]:
        """Return what sets it to a code of so much each."""
        return lambda code: self.set(code * scale)


def measured_v(bench: SharedRig, axis: int) -> float:
    """Give the voltage at an input; 0 V where nothing is connected."""
    if axis >= bench.n_axes:
        return 0.0
    value_v = bench.conditioned_v(axis)
    return value_v if isfinite(value_v) else OVERLOAD_V
