"""From the sensor's voltage to a displacement, as measured when the stage was commissioned."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from piezod.errors import DeviceError

_KNOTS = 131
_FROM, _TO = -0.1, 1.2  # what commissioning sweeps, in travels


class Calibration:
    """A curve through measured points, continued in a straight line beyond them.

    Args:
        sensor_v: (n,) V, n at least 2, strictly monotonic.
        position_um: (n,) displacement in µm at those voltages.
    """

    def __init__(self, sensor_v: Sequence[float], position_um: Sequence[float]) -> None:
        points = sorted(zip(map(float, sensor_v), map(float, position_um), strict=True))
        self._sensor_v = [voltage for voltage, _ in points]
        self._inner_v = self._sensor_v[
            1:-1
        ]  # the segment of a voltage: how many of these it is above
        self._position_um = [position for _, position in points]
        self._slope = [(x1 - x0) / (v1 - v0) for (v0, x0), (v1, x1) in pairwise(points)]

    def position_um(self, sensor_v: float) -> float:
        """Give the displacement in µm at a voltage in V. May be called in the loop."""
        i = bisect_right(self._inner_v, sensor_v)
        return self._position_um[i] + self._slope[i] * (sensor_v - self._sensor_v[i])


def commissioned(
    ideal_v: Callable[[float], float],
    travel_um: float,
    residual_pct: float,
    seed: np.random.SeedSequence,
) -> Calibration:
    """Measure the sensor's curve with a reference that is not perfect.

    Args:
        ideal_v: The sensor's voltage at a displacement in µm.
        travel_um: Travel of the stage in µm.
        residual_pct: Greatest error of the result over the travel, in % of travel.
        seed: Of the shape of that error, which is smooth.

    Raises:
        DeviceError: If the light has its maximum within the sweep, so that no curve exists.
    """
    position = np.linspace(_FROM, _TO, _KNOTS)
    sensor_v = [ideal_v(float(x) * travel_um) for x in position]
    steps = np.diff(sensor_v)
    if not (np.all(steps > 0) or np.all(steps < 0)):
        raise DeviceError(
            "the sensor cannot be calibrated: its voltage is not monotonic over the travel"
        )
    error = _smooth_error(position, seed) * residual_pct / 100
    return Calibration(sensor_v, list((position + error) * travel_um))


def _smooth_error(position: Any, seed: np.random.SeedSequence) -> Any:
    rng = np.random.default_rng(seed)
    waves = np.arange(1, 5)
    strength, phase = rng.standard_normal(4) / waves, rng.uniform(0, 2 * np.pi, 4)
    error = np.sin(np.pi * np.outer(position, waves) + phase) @ strength
    inside = (position >= 0) & (position <= 1)
    return error / np.max(np.abs(error[inside]))


def straight_line(ideal_v: Callable[[float], float], travel_um: float) -> Calibration:
    """Fit a line by least squares, which is all that is known of a sensor without calibration.

    Args:
        ideal_v: The sensor's voltage at a displacement in µm.
        travel_um: Travel of the stage in µm.
    """
    position_um = np.linspace(0, travel_um, 401)
    sensor_v = np.array([ideal_v(float(x)) for x in position_um])
    line = np.polynomial.Polynomial.fit(sensor_v, position_um, 1)
    ends = sensor_v[[0, -1]]
    return Calibration(list(ends), list(line(ends)))
