"""Notch filters: a loop with a notch at a mode does not excite the mode."""

from collections.abc import Iterable
from math import cos, exp, pi, sqrt
from typing import Final, NamedTuple

from piezod.dynamics.model import ComplexArray, Resonance

POLE_DAMPING: Final = 1.0
"""Damping ratio of the poles of a notch. Less delays the loop less, and more leaves more gain if
the mode is not where the notch is."""
HIGHEST_PER_RATE: Final = 0.4
"""Highest frequency of a notch over the sample rate. Sampling folds a mode above half the rate, so
that no notch would be at its frequency."""


class Notch(NamedTuple):
    """A notch in discrete time, with a static gain of one.

    y_k = b0 x_k + b1 x_k-1 + b2 x_k-2 - a1 y_k-1 - a2 y_k-2

    Attributes:
        b0, b1, b2, a1, a2: Coefficients.
    """

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float

    def at(self, z: ComplexArray) -> ComplexArray:
        """Return the response at points z, shape (n,)."""
        return (self.b0 + (self.b1 + self.b2 / z) / z) / (1.0 + (self.a1 + self.a2 / z) / z)


def notch(mode: Resonance, period_s: float) -> Notch:
    """Return the notch whose zeros are the poles of a mode, in samples."""
    b1, b2 = _roots(mode.frequency_hz * period_s, mode.damping)
    a1, a2 = _roots(mode.frequency_hz * period_s, POLE_DAMPING)
    gain = (1.0 + a1 + a2) / (1.0 + b1 + b2)
    return Notch(gain, gain * b1, gain * b2, a1, a2)


def notched(modes: Iterable[Resonance], period_s: float) -> tuple[Resonance, ...]:
    """Return the modes that can have a notch at this sample period, in s."""
    highest_hz = HIGHEST_PER_RATE / period_s
    return tuple(mode for mode in modes if mode.frequency_hz <= highest_hz)


def _roots(turns: float, damping: float) -> tuple[float, float]:
    """Return c1 and c2 of 1 + c1/z + c2/z², which is 0 at the poles of a sampled mode.

    Args:
        turns: Frequency of the mode times the sample period.
        damping: Its damping ratio, in (0, 1].
    """
    angle = 2.0 * pi * turns
    size = exp(-damping * angle)
    return -2.0 * size * cos(angle * sqrt(1.0 - damping**2)), size**2
