"""Points on a straight way: how far limits let it go, and how far a point is from it."""

from collections.abc import Sequence
from math import hypot, inf, nan
from typing import Final

from piezod.coordinates.matrices import Vector

SLACK: Final = 1e-9
"""Beyond a limit by this share of its range a point counts as inside: bounds have rounding
errors."""


def outside(point: Vector, low: Vector, high: Vector) -> int | None:
    """Return the first coordinate that is beyond its limits; None if all are within them.

    Real-time safe. A coordinate that is no number is beyond them.
    """
    for i, (value, least, most) in enumerate(zip(point, low, high, strict=True)):
        slack = SLACK * (most - least)
        if not least - slack <= value <= most + slack:
            return i
    return None


def share_within(start: Vector, step: Vector, low: Vector, high: Vector) -> float:
    """Return the share of a step, 0 to 1, that stays within limits: all coordinates stop together.

    Real-time safe. A coordinate that is beyond a limit may go back, not farther. One that a step is
    too small to change limits nothing.
    """
    share = 1.0
    for value, way, least, most in zip(start, step, low, high, strict=True):
        if value + way > value:
            share = min(share, max(most - value, 0.0) / way)
        elif value + way < value:
            share = min(share, max(value - least, 0.0) / -way)
    return share


def distance_to_path(point: Vector, path: Sequence[Vector]) -> float:
    """Return how far a point is from a path of straight lines; NaN if a coordinate is none.

    Args:
        point: The point.
        path: Points of the path, at least one.
    """
    nearest = inf
    for begin, end in zip(path, [*path[1:], path[-1]], strict=True):
        way = [b - a for a, b in zip(begin, end, strict=True)]
        off = [value - a for value, a in zip(point, begin, strict=True)]
        length = sum(each * each for each in way)
        along = sum(a * b for a, b in zip(off, way, strict=True))
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        apart = hypot(*(a - share * b for a, b in zip(off, way, strict=True)))
        if apart != apart:  # noqa: PLR0124 - NaN
            return nan
        nearest = min(nearest, apart)
    return nearest
