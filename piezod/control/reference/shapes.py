"""The shapes that waveforms are made of, each a function of time in s.

What they return is plain Python on floats: one value costs well under a microsecond and allocates
no array. Rounding never takes a value out of the range that the configuration promises.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final, TypeAlias

from piezod.config.envelopes import ConstantEnvelope, Envelope, ModulatedEnvelope
from piezod.config.waveforms import Multisine, Periodic, Staircase

Value: TypeAlias = Callable[[float], float]
Point: TypeAlias = tuple[float, float]

_TURN: Final = 2.0 * math.pi


def raised_cosine(turns: float) -> float:
    """Go from 0 up to 1 and back along a cosine while `turns` goes from 0 to 1."""
    return 0.5 - 0.5 * math.cos(_TURN * turns)


def raised_triangle(turns: float) -> float:
    """Go from 0 up to 1 and back along straight lines while `turns` goes from 0 to 1."""
    return 1.0 - abs(1.0 - 2.0 * turns)


def setpoint(level: float) -> Value:
    """Stay at one level."""
    return lambda _: level


def periodic(config: Periodic, shape: Callable[[float], float]) -> Value:
    """Repeat a shape between two levels, its swing scaled by the envelope."""
    low, high, span = config.low, config.high, config.high - config.low
    still = 0.5 if config.anchor == "middle" else 0.0
    frequency_hz, scale = config.frequency_hz, _scale(config.envelope)

    def value(t_s: float) -> float:
        elapsed_s = t_s if t_s > 0.0 else 0.0
        swing = scale(elapsed_s) * (shape(frequency_hz * elapsed_s % 1.0) - still)
        level = low + span * (still + swing)
        return level if level < high else high

    return value


def multisine(config: Multisine) -> Value:
    """Add up sinusoids."""
    low = config.low
    components = [
        (part.amplitude, part.frequency_hz, math.radians(part.phase_deg))
        for part in config.components
    ]

    def value(t_s: float) -> float:
        elapsed_s = t_s if t_s > 0.0 else 0.0
        level = low
        for amplitude, frequency_hz, phase in components:
            angle = _TURN * (frequency_hz * elapsed_s % 1.0) + phase
            level += amplitude * (1.0 - math.cos(angle))
        return level

    return value


def staircase(config: Staircase) -> Value:
    """Step from level to level."""
    levels, dwell_s = config.levels, config.dwell_s
    edges_s = [dwell_s * count for count in range(1, len(levels))]
    return lambda t_s: levels[bisect_right(edges_s, t_s)]


def polyline(points: Sequence[Point]) -> Value:
    """Join points by straight lines; hold the first and the last value.

    Args:
        points: Times in s, increasing, each with its value; at least one.
    """
    times_s = [time_s for time_s, _ in points]
    levels = [level for _, level in points]
    slopes = [
        (end - start) / (end_s - start_s) for (start_s, start), (end_s, end) in pairwise(points)
    ]
    lowest, highest = min(levels), max(levels)

    def value(t_s: float) -> float:
        index = bisect_right(times_s, t_s) - 1
        if index < 0:
            return levels[0]
        if index == len(slopes):
            return levels[-1]
        level = levels[index] + slopes[index] * (t_s - times_s[index])
        return min(max(level, lowest), highest)

    return value


def _scale(envelope: Envelope) -> Value:
    """Give the swing over time as a fraction of the full one."""
    match envelope:
        case ConstantEnvelope():
            return lambda _: 1.0
        case ModulatedEnvelope(depth=depth, frequency_hz=frequency_hz):
            return lambda t_s: 1.0 - depth * raised_cosine(frequency_hz * t_s % 1.0)
        case _:
            time_constant_s, final = envelope.time_constant_s, envelope.final_fraction
            return lambda t_s: final + (1.0 - final) * math.exp(-t_s / time_constant_s)
