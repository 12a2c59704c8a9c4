"""First values of the resonances of a response, from the poles of a rational approximation."""

import warnings
from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.interpolate import AAA

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

_TOLERANCES: Final = (0.3, 0.1, 0.03, 0.01, 0.001)
"""Relative distances at which the approximation ends: the noise is not known to it."""
_MOST_TERMS: Final = 12
_MOST_POLES: Final = 6
_LEAST_DAMPING, _MOST_DAMPING = 0.001, 1.0
_FOLDED_DAMPING: Final = 0.5
_BEYOND: Final = 3.0
"""Poles outside the lines by more than this factor are left out."""


def possible_modes(frequency_hz: FloatArray, response: ComplexArray) -> list[FloatArray]:
    """Return frequencies in Hz and damping ratios of possible resonances, each of shape (k, 2).

    Each array is of one approximation by the AAA algorithm (Nakatsukasa, Sète, Trefethen, SIAM J.
    Sci. Comput. 40, 2018), on the lines and their mirror images.

    Args:
        frequency_hz: (n,) frequencies, in Hz.
        response: (n,) response, without most of its delay.
    """
    line = 2j * np.pi * frequency_hz
    both, values = np.concatenate((line, -line)), np.concatenate((response, response.conj()))
    found = []
    for tolerance in _TOLERANCES:
        with warnings.catch_warnings():
            # Noise never converges: the terms limit the approximation.
            warnings.simplefilter("ignore", RuntimeWarning)
            poles = AAA(both, values, rtol=tolerance, max_terms=_MOST_TERMS).poles()
        upper = poles[poles.imag > 0.0]
        modes = np.stack((np.abs(upper) / (2.0 * np.pi), -upper.real / np.abs(upper)), axis=1)
        low, high = frequency_hz[0] / _BEYOND, _BEYOND * frequency_hz[-1]
        inside = (modes[:, 0] > low) & (modes[:, 0] < high)
        stable = (modes[:, 1] > _LEAST_DAMPING) & (modes[:, 1] < _MOST_DAMPING)
        found.append(modes[inside & stable][:_MOST_POLES])
    return found


def combinations_of_modes(
    possible: Iterable[FloatArray], count: int, rate_hz: float | None
) -> Iterator[FloatArray]:
    """Yield frequencies in Hz and damping ratios of resonances, each of shape (count, 2).

    Args:
        possible: What `possible_modes` returns.
        count: Number of resonances.
        rate_hz: Rate at which the drive was held; a weakly damped pole may then be the image of one
            above half of the rate. None if the drive was continuous.
    """
    for modes in possible:
        for chosen in combinations(modes, count):
            yield np.array(chosen)
            if rate_hz is not None:
                yield from _unfolded(np.array(chosen), rate_hz)


def _unfolded(modes: FloatArray, rate_hz: float) -> Iterator[FloatArray]:
    """Yield resonances of which the least damped one is above half of the rate."""
    least = int(np.argmin(modes[:, 1])) if modes.size else 0
    if not modes.size or modes[least, 1] > _FOLDED_DAMPING:
        return
    for place_hz in (rate_hz - modes[least, 0], rate_hz + modes[least, 0]):
        if place_hz <= 0.0:
            continue  # a pole beyond the rate is no image of one below it
        folded = modes.copy()
        # The same decay in time.
        folded[least] = place_hz, modes[least].prod() / place_hz
        yield folded
