"""Multisines: sums of sinusoids that repeat with a common period and have no high peaks."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_ROUNDS: Final = 300
_CLIPPED_AT: Final = (0.5, 0.95)
"""Level of the clipping in the first and in the last round, as a share of the peak."""
_POINTS_PER_CYCLE: Final = 16
"""Points per cycle of the highest line at which the peak is found; a peak between two points is at
most 2 % higher."""


@dataclass(frozen=True, eq=False)
class Multisine:
    """Sinusoids at whole multiples of a fundamental.

    The value at a time t is Σ amplitude · cos(2π h t / period + phase), with the harmonics h.
    """

    harmonics: IntArray  #: (n,) numbers of the harmonics, increasing.
    amplitudes: FloatArray  #: (n,) their amplitudes.
    phases_rad: FloatArray  #: (n,) their phases, in rad.
    peak: float  #: Largest magnitude of the sum.

    @property
    def crest_factor(self) -> float:
        """Peak over rms."""
        return float(self.peak / np.sqrt(0.5 * np.sum(self.amplitudes**2)))

    def sample(self, turns: FloatArray) -> FloatArray:
        """Return the sum at times in periods, shape (n,)."""
        angles = 2.0 * np.pi * np.outer(turns, self.harmonics) + self.phases_rad
        return np.asarray(np.cos(angles) @ self.amplitudes)


def odd_harmonics(lowest: float, highest: float, count: int) -> IntArray:
    """Return odd harmonics in almost geometric progression.

    A quadratic nonlinearity makes even harmonics of odd ones: they do not disturb any of these.

    Args:
        lowest: Lowest harmonic, at least 1.
        highest: Highest harmonic.
        count: Their number; fewer if there are not so many.
    """
    wanted = np.geomspace(max(lowest, 1.0), max(highest, 1.0), count)
    odd = 2 * np.floor(wanted / 2.0).astype(np.int64) + 1
    return np.unique(odd[odd <= highest])


def low_peak_multisine(harmonics: IntArray, amplitudes: FloatArray | None = None) -> Multisine:
    """Return a multisine whose phases give a low peak.

    The phases of Schroeder come first. Then the sum is clipped, and its phases are taken over, many
    times (Van der Ouderaa, Schoukens, Renneboog, IEEE Trans. Instrum. Meas. 37, 1988).

    Args:
        harmonics: (n,) numbers of the harmonics, increasing.
        amplitudes: (n,) their amplitudes, above 0; None for 1.
    """
    if amplitudes is None:
        amplitudes = np.ones(harmonics.size)
    order = np.arange(harmonics.size)
    phases = -np.pi * order * (order + 1) / harmonics.size
    size = 1 << int(np.ceil(np.log2(_POINTS_PER_CYCLE * harmonics[-1])))
    best = (np.inf, phases)
    for level in np.linspace(*_CLIPPED_AT, _ROUNDS):
        wave = _wave(harmonics, amplitudes, phases, size)
        peak = float(np.max(np.abs(wave)))
        best = min(best, (peak, phases), key=lambda each: each[0])
        clipped = np.clip(wave, -level * peak, level * peak)
        phases = np.angle(np.fft.rfft(clipped)[harmonics])
    return _starting_near_zero(harmonics, amplitudes, best[1], size)


def _wave(
    harmonics: IntArray, amplitudes: FloatArray, phases_rad: FloatArray, size: int
) -> FloatArray:
    spectrum = np.zeros(size // 2 + 1, dtype=np.complex128)
    spectrum[harmonics] = 0.5 * size * amplitudes * np.exp(1j * phases_rad)
    return np.fft.irfft(spectrum, size)


def _starting_near_zero(
    harmonics: IntArray, amplitudes: FloatArray, phases_rad: FloatArray, size: int
) -> Multisine:
    """Shift a multisine in time, so that it starts without a step."""
    wave = _wave(harmonics, amplitudes, phases_rad, size)
    turns = int(np.argmin(np.abs(wave) + np.abs(np.roll(wave, -1)))) / size
    shifted = np.angle(np.exp(1j * (phases_rad + 2.0 * np.pi * turns * harmonics)))
    return Multisine(harmonics, amplitudes, shifted, float(np.max(np.abs(wave))))
