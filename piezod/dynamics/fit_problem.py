"""The least-squares problem of a response: parameters, residuals, Jacobian, starts, covariance.

The parameters are, in this order: ln |gain| of each response, the phase of small loops in rad, the
exponent of creep, the delay in ms; then ln frequency and ln damping of each resonance; then the
shares of all resonances but the last.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from piezod.dynamics.measured import MeasuredResponse
from piezod.dynamics.poles import combinations_of_modes

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

RINGS_BELOW: Final = 0.5
"""Damping ratio below which a resonance is a mode of the mechanics, and no filter."""
KNOWN: Final = 0.1
"""Largest relative uncertainty of the frequency of a mode."""
SIGNIFICANT: Final = 3.0
"""Smallest share of a mode, in standard uncertainties."""
BEYOND: Final = 3.0
"""A filter may lie above the highest line by this factor, a mode not at all."""
LONGEST_DELAY_S: Final = 1.0
_PHASES, _CREEPS = (-0.3, 0.8), (-0.01, 0.03)
_SHARES, _DAMPINGS = (-1.0, 2.0), (0.001, 1.0)
_GAINS: Final = (0.1, 10.0)
"""Bounds of the parameters."""
_DELAYS, _REFINED, _STEPS = 5, 6, 300


class Parts(NamedTuple):
    """The parameters by their meaning.

    Attributes:
        fixed: Gains, phase, creep, delay.
        frequencies_hz: (n,) frequencies, in Hz.
        dampings: (n,) damping ratios.
        shares: (n,) shares, which add up to one.
    """

    fixed: FloatArray
    frequencies_hz: FloatArray
    dampings: FloatArray
    shares: FloatArray


@dataclass(frozen=True, eq=False)
class Solution:
    """A minimum.

    Attributes:
        parameters: The parameters.
        cost: Half of the sum of squares.
        jacobian: (residuals, parameters) derivatives.
        count: Number of resonances.
    """

    parameters: FloatArray
    cost: float
    jacobian: FloatArray
    count: int


class FitProblem:
    """The problem of several responses with the same dynamics.

    Args:
        used: The responses, each with at least two lines.
    """

    def __init__(self, used: Sequence[MeasuredResponse]) -> None:
        self._used, self.gains = tuple(used), len(used)
        self._frequency_hz = np.concatenate([each.frequency_hz for each in used])
        self._response = np.concatenate([each.response for each in used])
        self._weight = np.sqrt(2.0 / np.concatenate([each.variance for each in used]))
        sizes = [each.frequency_hz.size for each in used]
        self._which = np.repeat(np.arange(self.gains), sizes)
        # A stage may fall with rising voltage: its phase at low frequencies is half a turn.
        low = [np.median(each.response[: each.response.size // 4 + 1].real) for each in used]
        self.signs = np.where(np.array(low) < 0.0, -1.0, 1.0)
        self._gain = np.maximum(np.abs(low), 1e-300)
        self._low_hz, self._high_hz = self._frequency_hz.min(), self._frequency_hz.max()
        self._fixed = self.gains + 3
        self.residuals = 2 * self._frequency_hz.size

    def parts(self, solution: Solution) -> Parts:
        """Return the parameters of a solution by their meaning."""
        return self._split(solution.parameters, solution.count)

    def best(self, count: int) -> Solution | None:
        """Return the best solution with a number of resonances; None if nothing hints at them."""
        starts = sorted(self._starts(count), key=lambda each: self._start_cost(each, count))
        solved = [self._solve(start, count) for start in starts[:_REFINED]]
        return min(solved, key=lambda each: each.cost, default=None)

    def _starts(self, count: int) -> Iterator[FloatArray]:
        """Yield parameters to start from; the delay is unknown, so several are tried."""
        lines = max(self._used, key=lambda each: each.frequency_hz.size)
        sign = self.signs[self._used.index(lines)]
        f, response = lines.frequency_hz, sign * lines.response
        half = slice(0, f.size // 2 + 1)
        slope = -np.polyfit(f[half], np.unwrap(np.angle(response[half])), 1)[0] / (2.0 * np.pi)
        for delay_s in np.linspace(0.0, max(slope, 0.0), _DELAYS).tolist():
            head = [*np.log(self._gain), 0.0, 0.0, 1e3 * delay_s]
            if not count:
                yield np.array(head)
                continue
            undelayed = response * np.exp(2j * np.pi * f * delay_s)
            for modes in combinations_of_modes(f, undelayed, count):
                basis = _second_order(f / modes[:, :1], modes[:, 1]).T
                weights, *_ = np.linalg.lstsq(_real(basis), _real(undelayed), rcond=None)
                shares = np.clip(weights / (weights.sum() or 1.0), *_SHARES)
                yield np.array([*head, *np.log(modes).ravel(), *shares[:-1]])

    def criterion(self, solution: Solution) -> float:
        """Return the Bayesian information criterion, for an unknown scale of the variances."""
        n = self.residuals
        return float(n * np.log(2.0 * solution.cost / n) + solution.parameters.size * np.log(n))

    def admits(self, solution: Solution) -> bool:
        """Return whether the lines determine all modes of a solution."""
        parts, uncertain = self.parts(solution), self.uncertainties(solution)
        known = uncertain.frequencies_hz < KNOWN * parts.frequencies_hz
        inside = (parts.frequencies_hz > self._low_hz) & (parts.frequencies_hz < self._high_hz)
        significant = np.abs(parts.shares) > SIGNIFICANT * uncertain.shares
        within = (parts.shares > _SHARES[0]) & (parts.shares < _SHARES[1])
        is_filter = parts.dampings >= RINGS_BELOW
        return bool(np.all(within & (is_filter | (known & inside & significant))))

    def uncertainties(self, solution: Solution) -> Parts:
        """Return the standard uncertainties of a solution's parameters."""
        jacobian, own_end = solution.jacobian, self._fixed + 2 * solution.count
        freedom = max(jacobian.shape[0] - jacobian.shape[1], 1)
        # The scatter about the fit counts, if it is larger than the measured one.
        scale = max(1.0, 2.0 * solution.cost / freedom)
        covariance = scale * np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
        single = np.sqrt(np.diag(covariance))
        parts = self.parts(solution)
        # The last share is one minus the others.
        last = np.sqrt(max(float(covariance[own_end:, own_end:].sum()), 0.0))
        return Parts(
            single[: self._fixed],
            parts.frequencies_hz * single[self._fixed : own_end : 2],
            parts.dampings * single[self._fixed + 1 : own_end : 2],
            np.append(single[own_end:], last) if solution.count else np.empty(0),
        )

    def _split(self, parameters: FloatArray, count: int) -> Parts:
        own_end = self._fixed + 2 * count
        free = parameters[own_end:]
        shares = np.append(free, 1.0 - free.sum()) if count else np.empty(0)
        own = np.exp(parameters[self._fixed : own_end])
        return Parts(parameters[: self._fixed], own[::2], own[1::2], shares)

    def _bounds(self, count: int) -> tuple[FloatArray, FloatArray]:
        limits = [
            *np.log(self._gain)[:, None] + np.log(_GAINS),
            *(_PHASES, _CREEPS, (0.0, 1e3 * LONGEST_DELAY_S)),
            *([np.log((self._low_hz, BEYOND * self._high_hz)), np.log(_DAMPINGS)] * count),
            *([_SHARES] * max(count - 1, 0)),
        ]
        low, high = np.array(limits).T
        return low, high

    def _start_cost(self, start: FloatArray, count: int) -> float:
        return float(np.sum(self._distance(np.clip(start, *self._bounds(count)), count) ** 2))

    def _solve(self, start: FloatArray, count: int) -> Solution:
        bounds = self._bounds(count)
        found = least_squares(
            self._distance,
            np.clip(start, *bounds),
            self._derivatives,
            bounds=bounds,
            x_scale="jac",
            max_nfev=_STEPS,
            args=(count,),
        )
        return Solution(found.x, float(found.cost), np.asarray(found.jac), count)

    def _distance(self, parameters: FloatArray, count: int) -> FloatArray:
        factor, dynamics = self._factor(parameters, count), np.ones(1, dtype=np.complex128)
        if count:
            parts = self._split(parameters, count)
            dynamics = parts.shares @ self._modes(parts)[1]
        return _real(self._weight * (factor * dynamics - self._response))

    def _derivatives(self, parameters: FloatArray, count: int) -> FloatArray:
        """Return the Jacobian of the residuals, shape (residuals, parameters)."""
        f, factor = self._frequency_hz, self._factor(parameters, count)
        parts = self._split(parameters, count)
        ratio, modes = self._modes(parts)
        model = factor * (parts.shares @ modes if count else 1.0)
        columns = [np.where(self._which == i, model, 0.0) for i in range(self.gains)]
        columns += [-1j * model, -np.log(1j * f / self._low_hz) * model]
        columns += [-2e-3j * np.pi * f * model]
        for r, mode, damping, share in zip(ratio, modes, parts.dampings, parts.shares, strict=True):
            outer = -share * factor * mode**2
            columns += [outer * (2.0 * r**2 - 2j * damping * r), outer * 2j * damping * r]
        columns += [factor * (mode - modes[-1]) for mode in modes[:-1]]
        return np.stack([_real(self._weight * column) for column in columns], axis=1)

    def _factor(self, parameters: FloatArray, count: int) -> ComplexArray:
        """Return gain, phase, creep and delay at the lines."""
        fixed = self._split(parameters, count).fixed
        *_, phase, creep, delay_ms = fixed
        f = self._frequency_hz
        gain = (self.signs * np.exp(fixed[: self.gains]))[self._which]
        turned = np.exp(-1j * (phase + 2e-3 * np.pi * f * delay_ms))
        return np.asarray(gain * turned * (1j * f / self._low_hz) ** -creep)

    def _modes(self, parts: Parts) -> tuple[FloatArray, ComplexArray]:
        """Return frequency over that of each resonance, and its response, shape (n, lines)."""
        ratio = self._frequency_hz / parts.frequencies_hz[:, None]
        return ratio, _second_order(ratio, parts.dampings)


def _second_order(ratio: FloatArray, dampings: FloatArray) -> ComplexArray:
    """Return the responses of resonances, shape (n, lines), from ratios of that shape."""
    return np.asarray(1.0 / (1.0 - ratio**2 + 2j * dampings[:, None] * ratio), np.complex128)


def _real(values: ComplexArray) -> FloatArray:
    return np.concatenate((values.real, values.imag))
