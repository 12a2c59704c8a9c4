"""The response of a sampled stage whose drive is held from cycle to cycle.

The drive is a staircase. Its spectrum repeats at all multiples of the rate, attenuated, and
sampling folds the answers to these images onto the line. With f_m = f + m · rate, the response from
the written voltage to the sample is

    R(f) = Σ_m sin(πf/rate) / (πf_m/rate) · G(f_m) · exp(-iπf/rate),

whose last factor, the delay of the hold, is left out here. Source: K. J. Åström and B. Wittenmark,
"Computer-Controlled Systems", chapter 7.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from piezod.dynamics.model import ResponseModel

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

_IMAGES: Final = 3
"""Images on each side. The answer of a resonance falls with the square of the frequency."""


def images(frequency_hz: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return the frequencies of line and images, in Hz, and their weights, each of shape (m, n).

    Args:
        frequency_hz: (n,) lines, in Hz, above 0.
        rate_hz: Cycles per second.
    """
    numbers = np.arange(-_IMAGES, _IMAGES + 1)[:, None]
    places_hz = frequency_hz + numbers * rate_hz
    return places_hz, np.sinc(frequency_hz / rate_hz) * frequency_hz / places_hz


def held(model: ResponseModel, frequency_hz: FloatArray, rate_hz: float) -> ComplexArray:
    """Return the response of a stage with a held drive, without the delay of the hold, shape (n,).

    A stage without any resonance follows each step of the staircase at once: its response is the
    delay alone.

    Args:
        model: The stage; its delay does not include the hold.
        frequency_hz: (n,) lines, in Hz, above 0.
        rate_hz: Cycles per second.
    """
    if not model.resonances:
        return model.at(frequency_hz)
    places_hz, weights = images(frequency_hz, rate_hz)
    return np.asarray(np.sum(weights * model.at(places_hz), axis=0))
