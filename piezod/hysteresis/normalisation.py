"""The map between a physical range and the [0, 1] of the mathematics (eqs 27, 28, 31, 32)."""

from typing import NamedTuple, overload

from piezod.errors import ModelError
from piezod.hysteresis.memory import FloatArray


class AffineRange(NamedTuple):
    """A range whose lower end becomes 0 and whose upper end becomes 1; the unit is the caller's."""

    low: float
    high: float

    @classmethod
    def checked(cls, low: float, high: float) -> "AffineRange":
        """Return a range that can be divided by.

        Raises:
            ModelError: If the ends are not finite or do not increase.
        """
        if not 0.0 < high - low < float("inf"):
            message = f"a range needs finite ends that increase, got {low} to {high}"
            raise ModelError(message)
        return cls(float(low), float(high))

    @property
    def width(self) -> float:
        """Length of the range, in its unit."""
        return self.high - self.low

    @overload
    def to_unit(self, value: float) -> float: ...
    @overload
    def to_unit(self, value: FloatArray) -> FloatArray: ...
    def to_unit(self, value: float | FloatArray) -> float | FloatArray:
        """Return a physical value in units of the range; may be called in the loop."""
        return (value - self.low) / (self.high - self.low)

    @overload
    def from_unit(self, value: float) -> float: ...
    @overload
    def from_unit(self, value: FloatArray) -> FloatArray: ...
    def from_unit(self, value: float | FloatArray) -> float | FloatArray:
        """Return the physical value for one in units of the range; may be called in the loop."""
        return self.low + value * (self.high - self.low)
