"""The formulas of waveforms, as functions of time in seconds; the loop calls them in each cycle.

They are plain Python on floats: a value takes well under a microsecond and allocates no array.
Rounding never moves a value out of its bounds.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

Value: TypeAlias = Callable[[float], float]
"""Value over time: seconds since the start to a value. Real-time safe.

It depends on the time alone, so that it can be evaluated for any instant, in any order. Before its
start a waveform has its first value. Evaluation never raises; for a time that is not finite the
result is one of the values of the waveform, or NaN.
"""

_TWO_PI: Final = 2.0 * math.pi


def raised_cosine(frequency_hz: float) -> Value:
    """Return 0 to 1 and back to 0 in each period."""
    return lambda t_s: 0.5 - 0.5 * math.cos(_TWO_PI * (frequency_hz * t_s % 1.0))


def triangle(frequency_hz: float) -> Value:
    """Return straight lines from 0 to 1 and back to 0 in each period."""
    return lambda t_s: 1.0 - abs(1.0 - 2.0 * (frequency_hz * t_s % 1.0))


def swept_cosine(from_hz: float, to_hz: float, sweep_s: float, *, linear: bool) -> Value:
    """Return a raised cosine; its phase, the integral of the frequency, has no steps."""
    slope, rate = 0.5 * (to_hz - from_hz) / sweep_s, math.log(to_hz / from_hz) / sweep_s
    linear = linear or not rate

    def value(t_s: float) -> float:
        swept_s = t_s if t_s < sweep_s else sweep_s
        if linear:
            turns = (from_hz + slope * swept_s) * swept_s
        else:
            turns = from_hz * math.expm1(rate * swept_s) / rate
        turns += to_hz * (t_s - swept_s)
        return 0.5 - 0.5 * math.cos(_TWO_PI * (turns % 1.0))

    return value


def modulated(depth: float, frequency_hz: float) -> Value:
    """Return 1 minus a raised cosine."""
    cosine = raised_cosine(frequency_hz)
    return lambda t_s: 1.0 - depth * cosine(t_s)


def decaying(time_constant_s: float, final: float) -> Value:
    """Return an exponential from 1 to the final value."""
    return lambda t_s: final + (1.0 - final) * math.exp(-t_s / time_constant_s)


def swing(part: Value, scale: Value | None, low: float, high: float, anchor: float) -> Value:
    """Return a swing between two values, whose size may change over time.

    Args:
        part: The full swing over time from 0 s on, 0 to 1.
        scale: The size of the swing, 0 to 1; None if it is 1 at all times.
        low: Lowest value.
        high: Highest value; rounding does not exceed it.
        anchor: Part of the swing that stays constant while its size changes, 0 to 1.
    """
    span = high - low

    def value(t_s: float) -> float:
        # Before its start, and for NaN, a waveform has its first value.
        elapsed_s = t_s if t_s > 0.0 else 0.0
        moved = part(elapsed_s) - anchor
        if scale is not None:
            moved = scale(elapsed_s) * moved
        level = low + span * (anchor + moved)
        return level if level < high else high

    return value


def multisine(low: float, components: Sequence[tuple[float, float, float]]) -> Value:
    """Return a sum of sinusoids above a level.

    Args:
        low: Value if all sinusoids are at their lowest point.
        components: Amplitude, frequency in Hz and phase in radians of each.
    """

    def value(t_s: float) -> float:
        elapsed_s = t_s if t_s > 0.0 else 0.0
        level = low
        for amplitude, frequency_hz, phase in components:
            angle = _TWO_PI * (frequency_hz * elapsed_s % 1.0) + phase
            level += amplitude * (1.0 - math.cos(angle))
        return level

    return value
