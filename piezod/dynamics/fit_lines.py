"""The lines of responses and the model at them, with its derivatives.

The parameters are, in this order: ln |gain| of each response, the phase of small loops in rad, the
exponent of creep, the delay in ms; then ln frequency and ln damping of each resonance; then the
shares of all resonances but the last.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from piezod.dynamics.fit_solution import Parts
from piezod.dynamics.hold import images
from piezod.dynamics.measured import MeasuredResponse

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]


class _Point(NamedTuple):
    """The model at given parameters, for n lines with m images each, and k resonances."""

    parameters: FloatArray  #: The parameters.
    parts: Parts  #: The same by their meaning.
    slow: ComplexArray  #: (n,) gain, phase and creep.
    delayed: ComplexArray  #: (m, n) delay, with the weights of the images.
    ratios: FloatArray  #: (k, m, n) frequencies over those of the resonances.
    modes: ComplexArray  #: (k, m, n) responses of the resonances.
    dynamics: ComplexArray  #: (m, n) delay and resonances.
    model: ComplexArray  #: (n,) the response.


class FitLines:
    """The lines of several responses with the same dynamics.

    Args:
        used: The responses, each with at least two lines.
        rate_hz: Rate at which the drive was held; None if it was continuous.

    Attributes:
        count: Number of lines.
        fixed: Number of the parameters that no resonance has.
        signs: Sign of the gain of each response.
        gain: Magnitude of each gain at low frequencies.
        low_hz: Lowest frequency, in Hz.
        high_hz: Highest frequency, in Hz.
    """

    def __init__(self, used: Sequence[MeasuredResponse], rate_hz: float | None) -> None:
        frequency_hz = np.concatenate([each.frequency_hz for each in used])
        self.count, self.fixed = frequency_hz.size, len(used) + 3
        # A stage without a resonance has no images: it follows each step at once.
        self._line = frequency_hz[None], np.ones((1, self.count))
        self._held = self._line if rate_hz is None else images(frequency_hz, rate_hz)
        self._response = np.concatenate([each.response for each in used])
        self._weight = np.sqrt(2.0 / np.concatenate([each.variance for each in used]))
        self._which = np.repeat(np.arange(len(used)), [each.frequency_hz.size for each in used])
        # A stage may fall with rising voltage: its phase at low frequencies is half a turn.
        low = [np.median(each.response[: each.response.size // 4 + 1].real) for each in used]
        self.signs = np.where(np.array(low) < 0.0, -1.0, 1.0)
        self.gain = np.maximum(np.abs(low), 1e-300)
        self.low_hz, self.high_hz = frequency_hz.min(), frequency_hz.max()
        self._slope_of_creep = -np.log(1j * frequency_hz / self.low_hz)
        self._last: _Point | None = None

    def distance(self, parameters: FloatArray) -> FloatArray:
        """Return the residuals: model minus response, in standard uncertainties."""
        return real(self._weight * (self._at(parameters).model - self._response))

    def derivatives(self, parameters: FloatArray) -> FloatArray:
        """Return the Jacobian of the residuals, shape (residuals, parameters)."""
        point = self._at(parameters)
        own = self._which == np.arange(self.signs.size)[:, None]
        slow = np.stack((np.full(self.count, -1j), self._slope_of_creep))
        columns = np.concatenate(
            (np.where(own, point.model, 0.0), slow * point.model, self._of_dynamics(point))
        )
        return np.ascontiguousarray(real(self._weight * columns).T)

    def _of_dynamics(self, point: _Point) -> ComplexArray:
        """Return the derivatives of the model from the delay on, shape (parameters, n)."""
        parts, modes = point.parts, point.modes
        f, _ = self._images(parts)
        by_delay = -2e-3j * np.pi * np.sum(f * point.dynamics, axis=0)
        shares, dampings = (each[:, None, None] for each in (parts.shares, parts.dampings))
        outer = -shares * point.delayed * modes**2
        damped = 2j * dampings * point.ratios
        by_frequency = np.sum(outer * (2.0 * point.ratios**2 - damped), axis=1)
        by_damping = np.sum(outer * damped, axis=1)
        own = np.stack((by_frequency, by_damping), axis=1).reshape(-1, self.count)
        by_share = np.sum(point.delayed * (modes[:-1] - modes[-1:]), axis=1)
        return np.asarray(point.slow * np.concatenate((by_delay[None], own, by_share)))

    def _at(self, parameters: FloatArray) -> _Point:
        """Return the point of these parameters: a search asks for it twice."""
        if self._last is None or not np.array_equal(self._last.parameters, parameters):
            self._last = self._computed(parameters.copy())
        return self._last

    def _computed(self, parameters: FloatArray) -> _Point:
        parts = Parts.of(parameters, self.fixed)
        *gains, phase, creep, delay_ms = parts.fixed.tolist()
        gain = (self.signs * np.exp(gains))[self._which]
        slow = gain * np.exp(creep * self._slope_of_creep - 1j * phase)
        f, weights = self._images(parts)
        delayed = weights * np.exp(-2e-3j * np.pi * delay_ms * f)
        ratios = f / parts.frequencies_hz[:, None, None]
        modes = second_order(ratios, parts.dampings)
        dynamics = delayed
        if parts.shares.size:
            dynamics = delayed * np.sum(parts.shares[:, None, None] * modes, axis=0)
        model = slow * dynamics.sum(axis=0)
        return _Point(parameters, parts, slow, delayed, ratios, modes, dynamics, model)

    def _images(self, parts: Parts) -> tuple[FloatArray, FloatArray]:
        """Return the frequencies of lines and images, in Hz, and their weights, (m, n) each."""
        return self._held if parts.shares.size else self._line


def second_order(ratios: FloatArray, dampings: FloatArray) -> ComplexArray:
    """Return the responses of resonances from frequencies over theirs, shape (k, ...)."""
    dampings = dampings.reshape(-1, *[1] * (ratios.ndim - 1))
    return np.asarray(1.0 / (1.0 - ratios**2 + 2j * dampings * ratios), np.complex128)


def real(values: ComplexArray) -> FloatArray:
    """Return real and imaginary parts, one after the other along the last axis."""
    return np.concatenate((values.real, values.imag), axis=-1)
