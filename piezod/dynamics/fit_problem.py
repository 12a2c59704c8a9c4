"""The least-squares problem of a response: parameters, residuals, Jacobian, starts, covariance.

The parameters are, in this order: ln |gain| of each response, the phase of small loops in rad, the
exponent of creep, the delay in ms; then ln frequency and ln damping of each resonance; then the
shares of all resonances but the last.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from piezod.dynamics.fit_solution import Parts, Solution
from piezod.dynamics.hold import images
from piezod.dynamics.measured import MeasuredResponse
from piezod.dynamics.poles import combinations_of_modes

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

RINGS_BELOW: Final = 0.5
"""Damping ratio below which a resonance is a mode of the mechanics, and no filter."""
BETTER: Final = 10.0
"""Another explanation of the lines must lower the criterion by this: strong evidence."""
PER_RESONANCE: Final = 3
"""Parameters of a resonance."""
KNOWN: Final = 0.1
"""Largest relative uncertainty of the frequency of a mode."""
SIGNIFICANT: Final = 3.0
"""Smallest share of a mode, in standard uncertainties."""
BEYOND: Final = 3.0
"""A filter may lie above the highest line by this factor, a mode not at all."""
SHARP: Final = 0.01
"""Damping ratio below which a mode above half of the rate is not assumed."""
FASTEST_FILTER: Final = 0.35
"""Highest frequency of a filter alone, as a share of the rate: samples do not show a faster one."""
LONGEST_DELAY_S: Final = 1.0
_PHASES, _CREEPS = (-0.3, 0.8), (-0.01, 0.1)
_SHARES, _DAMPINGS = (-1.0, 2.0), (0.001, 1.0)
_GAINS: Final = (0.1, 10.0)
"""Bounds of the parameters."""
_DELAYS, _REFINED, _STEPS = 5, 6, 300
_FILTERS, _FILTER_DAMPING, _WEAK = 6, 0.8, 0.05
"""Filters that are tried in addition to the resonances of a solution."""
WEAK: Final = 0.2
"""A filter below all modes has a share of at least a half: it is in series with them. One with less
than this share is no filter, but small loops whose gain depends on the amplitude of a line."""


class FitProblem:
    """The problem of several responses with the same dynamics.

    Args:
        used: The responses, each with at least two lines.
        rate_hz: Rate at which the drive was held; None if it was continuous.
    """

    def __init__(self, used: Sequence[MeasuredResponse], rate_hz: float | None) -> None:
        self._used, self.gains = tuple(used), len(used)
        self._frequency_hz = np.concatenate([each.frequency_hz for each in used])
        # A stage without a resonance has no images: it follows each step at once.
        self._line = self._frequency_hz[None], np.ones((1, self._frequency_hz.size))
        self._held = self._line if rate_hz is None else images(self._frequency_hz, rate_hz)
        self._rate_hz = rate_hz
        self._fastest_filter_hz = np.inf if rate_hz is None else FASTEST_FILTER * rate_hz
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

    def best(self, count: int, before: Solution | None) -> Solution | None:
        """Return the best solution with a number of resonances; None if nothing hints at them.

        Args:
            count: The number.
            before: A solution with one resonance fewer, to start from too.
        """
        starts = sorted(self._starts(count), key=lambda each: self._start_cost(each, count))
        after = list(self._starts_after(before)) if before else []
        plain, folded = (
            # A weak filter is never close to the lines, so all of these are tried.
            self._best_of(
                [
                    *self._which_above(starts, count, above=above)[:_REFINED],
                    *self._which_above(after, count, above=above),
                ],
                count,
            )
            for above in (False, True)
        )
        if plain is None or folded is None:
            return plain or folded
        # A sharp mode whose image is at that of the lines explains them about as well as theirs.
        parts = self.parts(folded)
        sharp = parts.dampings[parts.frequencies_hz > 0.5 * (self._rate_hz or np.inf)] < SHARP
        better = self.criterion(plain) - self.criterion(folded) > BETTER
        return folded if better and not np.any(sharp) else plain

    def _best_of(self, starts: Sequence[FloatArray], count: int) -> Solution | None:
        solved = [self._solve(start, count) for start in starts]
        return min(solved, key=lambda each: each.cost, default=None)

    def _which_above(
        self, starts: Sequence[FloatArray], count: int, *, above: bool
    ) -> list[FloatArray]:
        """Return the starts with a mode above half of the rate, or those without."""
        return [each for each in starts if self._is_above(each, count) == above]

    def _is_above(self, start: FloatArray, count: int) -> bool:
        parts = self._split(start, count)
        above = parts.frequencies_hz > 0.5 * (self._rate_hz or np.inf)
        return bool(np.any(above & (parts.dampings < RINGS_BELOW)))

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
            for modes in combinations_of_modes(f, undelayed, count, self._rate_hz):
                basis = _second_order(f / modes[:, :1], modes[:, 1]).T
                weights, *_ = np.linalg.lstsq(_real(basis), _real(undelayed), rcond=None)
                shares = np.clip(weights / (weights.sum() or 1.0), *_SHARES)
                yield np.array([*head, *np.log(modes).ravel(), *shares[:-1]])

    def _starts_after(self, before: Solution) -> Iterator[FloatArray]:
        """Yield the parameters of a solution with a weak filter more, in front of the others."""
        parts = self.parts(before)
        own = np.log(np.stack((parts.frequencies_hz, parts.dampings), axis=1)).ravel()
        for frequency_hz in np.geomspace(self._low_hz, self._high_hz, _FILTERS + 2)[2:]:
            for share in (_WEAK, -_WEAK) if before.count else ():
                filtered = [np.log(frequency_hz), np.log(_FILTER_DAMPING)]
                shares = [share, *((1.0 - share) * parts.shares[:-1])]
                yield np.array([*parts.fixed, *filtered, *own, *shares])

    def criterion(self, solution: Solution) -> float:
        """Return the Bayesian information criterion, for an unknown scale of the variances."""
        n = self.residuals
        return float(n * np.log(2.0 * solution.cost / n) + solution.parameters.size * np.log(n))

    def admits(self, solution: Solution) -> bool:
        """Return whether the lines determine all modes of a solution, or else a filter."""
        parts, known = self.parts(solution), self._known(solution)
        is_mode = parts.dampings < RINGS_BELOW
        highest_hz = np.where(is_mode, self._high_hz, self._fastest_filter_hz)
        resolved = known & (parts.frequencies_hz < highest_hz)
        within = (parts.shares >= _SHARES[0]) & (parts.shares <= _SHARES[1])
        # A mode at the least damping has taken up the scatter of a single line.
        within &= parts.dampings > 1.01 * _DAMPINGS[0]
        # A fast filter beside others makes up for what they lack. Alone it is none.
        lowest = np.argmin(parts.frequencies_hz) if solution.count else 0
        return not solution.count or bool(
            np.all(within & (resolved | ~is_mode))
            and np.any(resolved)
            and (is_mode[lowest] or np.abs(parts.shares[lowest]) >= WEAK)
        )

    def is_exhausted(self, solution: Solution) -> bool:
        """Return whether no resonance more could be evident: what remains is scatter."""
        n, excess = self.residuals, max(2.0 * solution.cost / self.residuals, 1.0)
        return float(n * np.log(excess)) < BETTER + PER_RESONANCE * float(np.log(n))

    def is_folded(self, solution: Solution) -> bool:
        """Return whether the lines determine a mode above half of the rate only, by its images."""
        parts = self.parts(solution)
        is_mode = (parts.dampings < RINGS_BELOW) & self._known(solution)
        above = parts.frequencies_hz > 0.5 * (self._rate_hz or np.inf)
        inside = parts.frequencies_hz < self._high_hz
        return bool(np.any(is_mode & above) and not np.any(is_mode & inside))

    def _known(self, solution: Solution) -> npt.NDArray[np.bool_]:
        """Return which resonances are determined, in frequency and share, shape (n,)."""
        parts, uncertain = self.parts(solution), self.uncertainties(solution)
        known = uncertain.frequencies_hz < KNOWN * parts.frequencies_hz
        return known & (np.abs(parts.shares) > SIGNIFICANT * uncertain.shares)

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
            ftol=1e-6,
            max_nfev=_STEPS,
            args=(count,),
        )
        return Solution(found.x, float(found.cost), np.asarray(found.jac), count)

    def _distance(self, parameters: FloatArray, count: int) -> FloatArray:
        model = self._slow(parameters) * self._dynamics(parameters, count)[0]
        return _real(self._weight * (model - self._response))

    def _derivatives(self, parameters: FloatArray, count: int) -> FloatArray:
        """Return the Jacobian of the residuals, shape (residuals, parameters)."""
        slow = self._slow(parameters)
        dynamics, own = self._dynamics(parameters, count)
        model = slow * dynamics
        columns = [np.where(self._which == i, model, 0.0) for i in range(self.gains)]
        columns += [-1j * model, -np.log(1j * self._frequency_hz / self._low_hz) * model]
        columns += [slow * each for each in own]
        return np.stack([_real(self._weight * column) for column in columns], axis=1)

    def _slow(self, parameters: FloatArray) -> ComplexArray:
        """Return gain, phase and creep at the lines."""
        phase, creep = parameters[self.gains : self.gains + 2]
        gain = (self.signs * np.exp(parameters[: self.gains]))[self._which]
        fallen = (1j * self._frequency_hz / self._low_hz) ** -creep
        return np.asarray(gain * np.exp(-1j * phase) * fallen)

    def _dynamics(
        self, parameters: FloatArray, count: int
    ) -> tuple[ComplexArray, Sequence[ComplexArray]]:
        """Return delay and resonances at the lines, with their derivatives from the delay on."""
        parts = self._split(parameters, count)
        f, weights = self._held if count else self._line
        turn = -2e-3j * np.pi * f
        factor = weights * np.exp(turn * parts.fixed[-1])
        ratios = f / parts.frequencies_hz[:, None, None]
        modes = _second_order(ratios, parts.dampings)
        total = factor * (np.tensordot(parts.shares, modes, 1) if count else 1.0)
        columns = [turn * total]
        for ratio, mode, damping, share in zip(
            ratios, modes, parts.dampings, parts.shares, strict=True
        ):
            outer = -share * factor * mode**2
            columns += [outer * (2.0 * ratio**2 - 2j * damping * ratio)]
            columns += [outer * 2j * damping * ratio]
        columns += [factor * (mode - modes[-1]) for mode in modes[:-1]]
        return total.sum(axis=0), [column.sum(axis=0) for column in columns]


def _second_order(ratios: FloatArray, dampings: FloatArray) -> ComplexArray:
    """Return the responses of resonances from frequencies over theirs, shape (n, ...)."""
    dampings = dampings.reshape(-1, *[1] * (ratios.ndim - 1))
    return np.asarray(1.0 / (1.0 - ratios**2 + 2j * dampings * ratios), np.complex128)


def _real(values: ComplexArray) -> FloatArray:
    return np.concatenate((values.real, values.imag))
