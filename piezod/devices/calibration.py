"""Calibrations from the value of a channel to µm or V at the actuator, and back."""

from bisect import bisect_right
from collections.abc import Iterable
from itertools import pairwise
from math import isfinite, nan
from typing import Final, Protocol

from piezod.config.channels import (
    Calibration,
    LineCalibration,
    PolynomialCalibration,
    TableCalibration,
)
from piezod.config.polynomial import derivative, evaluate

_KNOTS: Final = 64
"""Number of intervals of a polynomial's range; they give the search a narrow first bracket."""
_STEPS: Final = 60
"""Largest number of steps: bisection alone reaches the last bit between two knots in fewer."""


class Curve(Protocol):
    """A calibration; it rises or falls strictly. All methods are real-time safe."""

    def physical(self, value: float) -> float:
        """Return µm, or V at the actuator, at a channel's value; NaN outside its range."""
        ...

    def beyond(self, value: float) -> float:
        """Return the same, extended along a straight line outside the range."""
        ...

    def value(self, physical: float) -> float:
        """Return the channel's value at µm or V at the actuator; NaN if there is none."""
        ...


def curve_of(calibration: Calibration) -> Curve | None:
    """Return the curve of a calibration; None if the channel's values are physical already."""
    match calibration:
        case LineCalibration():
            if calibration.gain == 1.0 and calibration.offset == 0.0:
                return None
            return StraightLine(calibration.gain, calibration.offset)
        case PolynomialCalibration():
            return PolynomialCurve(calibration.coefficients, *calibration.values)
        case TableCalibration():
            return TableCurve(calibration.points())


class StraightLine:
    """Implements `Curve`: gain · value + offset.

    Args:
        gain: Physical units per unit of the channel; not 0.
        offset: Physical value at the channel's value 0.
    """

    def __init__(self, gain: float, offset: float) -> None:
        self._gain, self._offset = gain, offset

    def physical(self, value: float) -> float:
        """Return the physical value at a channel's value."""
        return self._gain * value + self._offset

    def beyond(self, value: float) -> float:
        """Return the same: a straight line goes on."""
        return self._gain * value + self._offset

    def value(self, physical: float) -> float:
        """Return the channel's value at a physical value."""
        return (physical - self._offset) / self._gain


class TableCurve:
    """Implements `Curve`: straight lines through points.

    Args:
        points: Value and physical value of each point, at least two, strictly monotonic.
    """

    def __init__(self, points: Iterable[tuple[float, float]]) -> None:
        self._forth = _Segments(points)
        self._back = _Segments((physical, value) for value, physical in self._forth.points)

    def physical(self, value: float) -> float:
        """Return the physical value at a channel's value; NaN outside the points."""
        return self._forth.at(value) if self._forth.holds(value) else nan

    def beyond(self, value: float) -> float:
        """Return the physical value at a channel's value, also outside the points."""
        return self._forth.at(value)

    def value(self, physical: float) -> float:
        """Return the channel's value at a physical value; NaN outside the points."""
        if not self._back.holds(physical):
            return nan
        # Rounding must not give a value that the channel cannot be set to.
        return min(max(self._back.at(physical), self._forth.first), self._forth.last)


class _Segments:
    """Straight lines through points, sorted by x, and extended beyond both ends."""

    def __init__(self, points: Iterable[tuple[float, float]]) -> None:
        self.points = sorted((float(x), float(y)) for x, y in points)
        self._x, self._y = [x for x, _ in self.points], [y for _, y in self.points]
        self._inner = self._x[1:-1]  # the number of these up to x is the segment of x
        self._slope = [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairwise(self.points)]
        self.first, self.last = self._x[0], self._x[-1]

    def holds(self, x: float) -> bool:
        return self.first <= x <= self.last

    def at(self, x: float) -> float:
        i = bisect_right(self._inner, x)
        return self._y[i] + self._slope[i] * (x - self._x[i])


class PolynomialCurve:
    """Implements `Curve`: c0 + c1·value + c2·value² + ….

    Args:
        coefficients: c0, c1, c2, …
        low: Lowest value of its range.
        high: Highest value of its range; the polynomial is strictly monotonic between the two.
    """

    def __init__(self, coefficients: Iterable[float], low: float, high: float) -> None:
        self._coefficients = tuple(coefficients)
        self._slope = derivative(self._coefficients)
        self._low, self._high = low, high
        self._sign = 1.0 if self._at(high) > self._at(low) else -1.0
        width = high - low
        self._values = [low + width * i / _KNOTS for i in range(_KNOTS)] + [high]
        self._reached = [self._sign * self._at(value) for value in self._values]

    def physical(self, value: float) -> float:
        """Return the physical value at a channel's value; NaN outside the range."""
        return self._at(value) if self._low <= value <= self._high else nan

    def beyond(self, value: float) -> float:
        """Return the physical value at a channel's value, along the tangent outside the range."""
        end = min(max(value, self._low), self._high)
        return self._at(end) + evaluate(self._slope, end) * (value - end)

    def value(self, physical: float) -> float:
        """Return the channel's value at a physical value; NaN if there is none.

        The method is Newton's; a step that leaves the bracket is replaced by a bisection.
        """
        # The sign turns a falling curve into a rising one, so that one search serves both.
        wanted, reached = self._sign * physical, self._reached
        if not reached[0] <= wanted <= reached[-1]:
            return nan
        # The first knot above the wanted value ends the bracket; the last one for the upper end.
        knot = min(max(bisect_right(reached, wanted), 1), _KNOTS)
        low, high = self._values[knot - 1], self._values[knot]
        value = 0.5 * (low + high)
        for _ in range(_STEPS):
            error = self._sign * self._at(value) - wanted
            if error == 0.0:
                break
            low, high = (value, high) if error < 0.0 else (low, value)
            slope = self._sign * evaluate(self._slope, value)
            following = value - error / slope if slope > 0.0 else nan
            if not (isfinite(following) and low < following < high):
                following = 0.5 * (low + high)
            if following == value:  # no number lies between the two ends of the bracket
                break
            value = following
        return value

    def _at(self, value: float) -> float:
        return evaluate(self._coefficients, value)
