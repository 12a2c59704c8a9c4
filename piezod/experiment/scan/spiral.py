"""The path of a spiral: outward at a constant speed, more slowly near its centre, and back.

Its radius grows by a pixel in each turn. At a constant speed the turns about the centre would be
faster and faster, so their frequency is limited.
"""

from collections.abc import Callable

import numpy as np

from piezod.hysteresis.memory import FloatArray

_STEPS = 30
"""Steps of Newton's method; the time is convex in the angle, so each is nearer."""


class Spiral:
    """A spiral in units of its pixels.

    Args:
        across: Number of pixels across it.
        pixel_s: Time of a pixel where its speed is constant, in s.
        fastest_hz: Most turns in a second; infinite for no limit.
    """

    def __init__(self, across: int, pixel_s: float, fastest_hz: float) -> None:
        self._scale_s = pixel_s / (2.0 * np.pi)
        self._inner_2 = 1.0 + (1.0 / (pixel_s * fastest_hz)) ** 2
        self.duration_s = float(self._time_s(np.array(np.pi * across)))
        """Time of the way out, in s."""

    def _time_s(self, angle: FloatArray) -> FloatArray:
        """Return when it is at an angle: dt / d(angle) = scale * sqrt(inner_2 + angle**2)."""
        root = np.sqrt(self._inner_2 + angle**2)
        inside = self._inner_2 * np.arcsinh(angle / np.sqrt(self._inner_2))
        return np.asarray(0.5 * self._scale_s * (angle * root + inside))

    def at(self, t_s: FloatArray) -> FloatArray:
        """Return the place at instants since the centre, shape (n, 2), in pixels."""
        late = np.abs(t_s)  # the spiral goes on through its centre
        angle = np.sqrt(2.0 * late / self._scale_s)
        for _ in range(_STEPS):
            slope = self._scale_s * np.sqrt(self._inner_2 + angle**2)
            angle = angle - (self._time_s(angle) - late) / slope
        radius = np.sign(t_s) * angle / (2.0 * np.pi)
        return np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)


def closed_path(
    at: Callable[[FloatArray], FloatArray], active: int, points: int, interval_s: float
) -> FloatArray:
    """Return a path, and the way from its end to its beginning, without a jump of its speed.

    Args:
        at: Returns the places at instants, shape (n, 2).
        active: Points of the path, the first one half an interval after its begin.
        points: Points with the way back.
        interval_s: Time between two points, in s.
    """
    way = at((np.arange(active, dtype=np.float64) + 0.5) * interval_s)
    steps = points - active + 1
    u = (np.arange(1, steps) / steps)[:, None]
    end, begin = way[-1], way[0]
    # Speeds for the whole way back, and the polynomial of third degree with them.
    leaving, arriving = steps * (end - way[-2]), steps * (way[1] - begin)
    square = 3.0 * (begin - end) - 2.0 * leaving - arriving
    cube = leaving + arriving - 2.0 * (begin - end)
    return np.concatenate((way, end + leaving * u + square * u**2 + cube * u**3))
