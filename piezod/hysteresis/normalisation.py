"""The map between a physical range and [0, 1]: paper eq. (27), eq. (28), eq. (31) and eq. (32)."""

from typing import NamedTuple, overload

from piezod.errors import ModelError
from piezod.hysteresis.memory import FloatArray


class AffineRange(NamedTuple):
    """A physical range; its lower end maps to 0 and its upper end to 1. The unit is the caller's.

    The ends are the minimum and maximum of paper eq. (28).
    """

    low: float
    high: float

    @classmethod
    def checked(cls, low: float, high: float) -> "AffineRange":
        """Return a range of finite, positive width.

        Raises:
            ModelError: If the ends are not finite or do not increase.
        """
        if not 0.0 < high - low < float("inf"):
            message = f"the ends of a range must be finite and increase, got {low} to {high}"
            raise ModelError(message)
        return cls(float(low), float(high))

    @property
    def width(self) -> float:
        """Width of the range, in its unit."""
        return self.high - self.low

    @overload
    def to_unit(self, value: float) -> float: ...
    @overload
    def to_unit(self, value: FloatArray) -> FloatArray: ...
    def to_unit(self, value: float | FloatArray) -> float | FloatArray:
        """Return a physical value in units of the range, paper eq. (27). Real-time safe."""
        return (value - self.low) / (self.high - self.low)

    @overload
    def from_unit(self, value: float) -> float: ...
    @overload
    def from_unit(self, value: FloatArray) -> FloatArray: ...
    def from_unit(self, value: float | FloatArray) -> float | FloatArray:
        """Return the physical value, paper eq. (31) and eq. (32). Real-time safe."""
        return self.low + value * (self.high - self.low)
