"""The shapes of waveforms, each a function of time in s. Real-time safe.

A shape is plain Python on floats: one value takes well under a microsecond and allocates no array.
Rounding never moves a value out of the range that the configuration promises.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

from piezod.config.envelopes import ConstantEnvelope, Envelope, ModulatedEnvelope
from piezod.config.waveforms import Multisine, Periodic

Value: TypeAlias = Callable[[float], float]
Point: TypeAlias = tuple[float, float]

_TWO_PI: Final = 2.0 * math.pi


def raised_cosine(turns: float) -> float:
    """Return a raised cosine: 0 to 1 and back to 0 while `turns` goes from 0 to 1."""
    return 0.5 - 0.5 * math.cos(_TWO_PI * turns)


def raised_triangle(turns: float) -> float:
    """Return a triangle: 0 to 1 and back to 0 while `turns` goes from 0 to 1."""
    return 1.0 - abs(1.0 - 2.0 * turns)


def setpoint(level: float) -> Value:
    """Return a constant."""
    return lambda _: level


def periodic(config: Periodic, shape: Callable[[float], float]) -> Value:
    """Return a periodic waveform between two levels, whose swing the envelope scales."""
    low, high, span = config.low, config.high, config.high - config.low
    anchor = 0.5 if config.anchor == "middle" else 0.0
    frequency_hz, scale = config.frequency_hz, _scale(config.envelope)

    def value(t_s: float) -> float:
        # Before its start, and for NaN, a waveform has its first value.
        elapsed_s = t_s if t_s > 0.0 else 0.0
        swing = scale(elapsed_s) * (shape(frequency_hz * elapsed_s % 1.0) - anchor)
        level = low + span * (anchor + swing)
        return level if level < high else high

    return value


def multisine(config: Multisine) -> Value:
    """Return a sum of sinusoids above the lowest level."""
    low = config.low
    components = [
        (part.amplitude, part.frequency_hz, math.radians(part.phase_deg))
        for part in config.components
    ]

    def value(t_s: float) -> float:
        elapsed_s = t_s if t_s > 0.0 else 0.0
        level = low
        for amplitude, frequency_hz, phase in components:
            angle = _TWO_PI * (frequency_hz * elapsed_s % 1.0) + phase
            level += amplitude * (1.0 - math.cos(angle))
        return level

    return value


def staircase(edges_s: Sequence[float], levels: Sequence[float]) -> Value:
    """Return a waveform that steps from level to level.

    Args:
        edges_s: Times in s, increasing, at which one level follows another.
        levels: Levels, one more than edges.
    """
    return lambda t_s: levels[bisect_right(edges_s, t_s)]


def polyline(times_s: Sequence[float], levels: Sequence[float]) -> Value:
    """Return straight lines between points; before and after them the value is constant.

    Args:
        times_s: Times in s, increasing; at least one.
        levels: The value at each of them.
    """
    last = len(times_s) - 1

    def value(t_s: float) -> float:
        index = bisect_right(times_s, t_s) - 1
        if index < 0:
            return levels[0]
        if index == last:
            return levels[-1]
        start_s, start, end = times_s[index], levels[index], levels[index + 1]
        level = start + (end - start) / (times_s[index + 1] - start_s) * (t_s - start_s)
        # Rounding may carry the last bit beyond the end of the line.
        return min(max(level, min(start, end)), max(start, end))

    return value


def _scale(envelope: Envelope) -> Value:
    """Return the swing over time, as a fraction of the full swing."""
    match envelope:
        case ConstantEnvelope():
            return lambda _: 1.0
        case ModulatedEnvelope(depth=depth, frequency_hz=frequency_hz):
            return lambda t_s: 1.0 - depth * raised_cosine(frequency_hz * t_s % 1.0)
        case _:
            time_constant_s, final = envelope.time_constant_s, envelope.final_fraction
            return lambda t_s: final + (1.0 - final) * math.exp(-t_s / time_constant_s)
