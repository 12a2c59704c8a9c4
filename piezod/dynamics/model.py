"""The frequency response of a stage: a delay, and one or several modes side by side."""

from dataclasses import dataclass
from math import isfinite

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

_SUM_OF_SHARES = 1e-6


@dataclass(frozen=True, slots=True)
class Resonance:
    """A second-order mode."""

    frequency_hz: float  #: Undamped frequency, in Hz, above 0.
    damping: float  #: Damping ratio, in (0, 1].
    #: Its part of the static displacement, in (-1, 2); the shares of all modes add up to 1.
    share: float = 1.0

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return its response, with a static gain of one, at frequencies in Hz, shape (n,)."""
        ratio = frequency_hz / self.frequency_hz
        return np.asarray(1.0 / (1.0 - ratio**2 + 2j * self.damping * ratio))


@dataclass(frozen=True, slots=True)
class ResponseModel:
    """The linear dynamics of a stage, with a static gain of one.

    G(f) = exp(-2πi f delay) Σ_k share_k / (1 - (f/f_k)² + 2i ζ_k f/f_k)

    Raises:
        ModelError: If a value is out of its range, or the shares do not add up to one.
    """

    #: Delay from the drive to the sample, in s, at least 0, sensor and hold included.
    delay_s: float
    #: The modes, by frequency; empty for a stage that only delays.
    resonances: tuple[Resonance, ...] = ()

    def __post_init__(self) -> None:
        """Check the values."""
        if not (isfinite(self.delay_s) and self.delay_s >= 0.0):
            raise ModelError(f"delay_s must be at least 0 s (got {self.delay_s:g})")
        for mode in self.resonances:
            if not (isfinite(mode.frequency_hz) and mode.frequency_hz > 0.0):
                raise ModelError(f"a mode must be above 0 Hz (got {mode.frequency_hz:g} Hz)")
            if not 0.0 < mode.damping <= 1.0:
                raise ModelError(f"a damping must be in (0, 1] (got {mode.damping:g})")
        total = sum(mode.share for mode in self.resonances)
        if self.resonances and not abs(total - 1.0) <= _SUM_OF_SHARES:
            raise ModelError(f"the shares of all modes must add up to 1 (got {total:g})")

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the response at frequencies in Hz, shape (n,)."""
        delayed = np.exp(-2j * np.pi * frequency_hz * self.delay_s)
        if not self.resonances:
            return np.asarray(delayed)
        modes = sum(
            (mode.share * mode.at(frequency_hz) for mode in self.resonances),
            np.zeros(frequency_hz.shape, dtype=np.complex128),
        )
        return np.asarray(delayed * modes)
