"""Codes of the converters to values and back: pure."""

from math import nan
from typing import Final, NamedTuple


class Polynomial(NamedTuple):
    """A polynomial around an origin."""

    coefficients: tuple[float, ...]  #: c0, c1, c2, …
    origin: float = 0.0  #: It is subtracted before.

    def __call__(self, value: float) -> float:
        """Return its value. Real-time safe."""
        distance, result = value - self.origin, 0.0
        for coefficient in reversed(self.coefficients):
            result = result * distance + coefficient
        return result


class Converter(NamedTuple):
    """Conversion between the codes of a channel and its values in V."""

    to_v: Polynomial  #: From a code to V.
    from_v: Polynomial  #: From V to a code.
    most: int  #: Highest code; the lowest one is 0.
    saturates: bool = True  #: Whether a sample at an end of the range says nothing.

    @property
    def range_v(self) -> tuple[float, float]:
        """Lowest and highest voltage."""
        ends = self.to_v(0.0), self.to_v(float(self.most))
        return min(ends), max(ends)

    def value(self, code: int) -> float:
        """Return the voltage of a code. Real-time safe."""
        return self.to_v(code)

    def sample(self, code: int) -> float:
        """Return the voltage of a sample; NaN at an end of the range. Real-time safe."""
        return self.to_v(code) if not self.saturates or 0 < code < self.most else nan

    def code(self, value_v: float) -> int:
        """Return the nearest code of a voltage. Real-time safe."""
        return min(max(round(self.from_v(value_v)), 0), self.most)


_SAME: Final = Polynomial((0.0, 1.0))
LEVEL: Final = Converter(_SAME, _SAME, 1, saturates=False)
"""Conversion of a digital line: 1 if it is high, 0 if it is low."""
