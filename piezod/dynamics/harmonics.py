"""What is known of a stage at the harmonics of a period, and which of them can be learned."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from piezod.dynamics.model import ComplexArray, FloatArray

GAIN = 0.7
"""λ: share of an error that a pass corrects. That of the mean is corrected as a whole, because the
mean drifts from pass to pass."""
SLOWEST = 0.75
"""Largest factor by which the error of a learned harmonic may shrink per pass."""
LEAST_RESPONSE = 0.05
"""A harmonic is not learned if the stage follows it by less than this: it would take more voltage,
and more slew rate, than all others."""
MEASURED_SHIFT, STORED_SHIFT = 0.003, 0.01
"""The frequencies of the modes may be wrong by this share, if they were measured just before, and
if they were measured on another day: they depend on load and temperature."""

Lines: TypeAlias = np.ndarray[tuple[int], np.dtype[np.bool_]]
"""Mask of the mean and of the harmonics of a period."""
ResponseAt: TypeAlias = Callable[[FloatArray], ComplexArray]
"""Returns a response at frequencies in Hz."""


def response_doubt(response: ResponseAt, frequency_hz: FloatArray, shift: float) -> FloatArray:
    """Return the largest relative error of a response if its modes are shifted, shape (n,).

    Args:
        response: The response.
        frequency_hz: (n,) frequencies, in Hz.
        shift: Share by which the frequencies of the modes may be wrong.
    """
    known = response(frequency_hz)
    shifted = [response(frequency_hz * factor) for factor in (1.0 + shift, 1.0 - shift)]
    return np.asarray(np.max([np.abs(other / known - 1.0) for other in shifted], axis=0))


@dataclass(frozen=True)
class Harmonics:
    """What is known at each harmonic of a period, the mean first, shape (n // 2 + 1,) each."""

    response: ComplexArray  #: From the input to the samples, with a static gain of one.
    sensor: ComplexArray  #: From the displacement to the samples; its mean is one.
    learned: Lines  #: Whether a harmonic is learned; the mean always is.

    @classmethod
    def known(
        cls,
        frequency_hz: FloatArray,
        response: ResponseAt,
        sensor: ResponseAt,
        uncertainty: FloatArray,
        shift: float,
    ) -> "Harmonics":
        """Return the harmonics, and which of them are known well enough to be learned.

        Args:
            frequency_hz: (n // 2 + 1,) frequencies, in Hz, from 0.
            response: From the input to the samples.
            sensor: From the displacement to the samples.
            uncertainty: (n // 2 + 1,) relative error of the response; inf where it was not
                measured.
            shift: Share by which the frequencies of the modes may be wrong.
        """
        doubt = uncertainty + response_doubt(response, frequency_hz, shift)
        followed = response(frequency_hz)
        learned = 1.0 - GAIN * (1.0 - doubt) <= SLOWEST
        learned &= np.abs(followed) >= LEAST_RESPONSE
        learned[0] = True
        return cls(followed, sensor(frequency_hz), learned)
