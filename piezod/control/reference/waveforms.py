"""Waveforms as functions of time.

A value depends on the time alone, so that it can be evaluated for any instant, in any order. Before
its start a waveform has its first value. Evaluation never raises; for a time that is not finite the
result is one of the values of the waveform, or NaN.
"""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.config.combined_waveforms import Sequence, Sum
from piezod.config.packed_waveforms import LoopWaveform, PackedPath
from piezod.config.random_path import random_path
from piezod.config.waveforms import (
    Csv,
    Multisine,
    Points,
    Reversals,
    Setpoint,
    Sine,
    Staircase,
    Triangle,
)
from piezod.control.reference import shapes

Value: TypeAlias = Callable[[float], float]


@dataclass(frozen=True, slots=True)
class Waveform:
    """A command or a drive over time, in the unit of its configuration.

    Attributes:
        value: Returns the value at a time in s. Real-time safe.
        low: Lower bound of all values.
        high: Upper bound of all values.
    """

    value: Value
    low: float
    high: float

    def sample(self, t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the values at many times; they are exactly those of `value`.

        Args:
            t_s: Times in s, shape (n,).

        Returns:
            Values, shape (n,).
        """
        return np.fromiter(map(self.value, t_s.tolist()), np.float64, t_s.size)


def build_waveform(config: LoopWaveform, duration_s: float) -> Waveform:
    """Return the waveform of a configuration; real-time safe if it was packed.

    Args:
        config: Its configuration.
        duration_s: Longest time that will be evaluated, in s. A path of random reversals ends at
            the first turning point after that; its beginning does not depend on the duration.
    """
    low, high = config.bounds()
    return Waveform(_value(config, duration_s), low, high)


def _value(config: LoopWaveform, duration_s: float) -> Value:
    match config:
        case PackedPath(times_s=times_s, levels=levels, stepped=stepped):
            value = (shapes.staircase if stepped else shapes.polyline)(times_s, levels)
        case Setpoint(level=level):
            value = shapes.setpoint(level)
        case Sine():
            value = shapes.periodic(config, shapes.raised_cosine)
        case Triangle():
            value = shapes.periodic(config, shapes.raised_triangle)
        case Multisine():
            value = shapes.multisine(config)
        case Staircase(levels=levels, dwell_s=dwell_s):
            edges_s = [dwell_s * count for count in range(1, len(levels))]
            value = shapes.staircase(edges_s, levels)
        case Reversals():
            value = shapes.polyline(*zip(*random_path(config, duration_s), strict=True))
        case Csv(points=points) | Points(points=points):
            value = shapes.polyline(*zip(*points, strict=True))
        case Sum():
            value = _sum([_value(part, duration_s) for part in config.parts])
        case _:
            value = _sequence(config)
    return value


def _sum(parts: list[Value]) -> Value:
    def value(t_s: float) -> float:
        total = 0.0
        for part in parts:
            total += part(t_s)
        return total

    return value


def _sequence(config: Sequence) -> Value:
    durations = [part.duration_s for part in config.parts]
    starts = [0.0, *accumulate(durations[:-1])]
    parts = [_value(part.waveform, part.duration_s) for part in config.parts]

    def value(t_s: float) -> float:
        index = max(bisect_right(starts, t_s) - 1, 0)
        local_s = t_s - starts[index]
        return parts[index](local_s if local_s < durations[index] else durations[index])

    return value
