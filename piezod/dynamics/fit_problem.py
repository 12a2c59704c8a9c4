"""The least-squares problem of a response: starts, solutions, covariance.

The order of the parameters is that of `fit_lines`.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from piezod.dynamics.fit_lines import ComplexArray, FitLines, FloatArray, real, second_order
from piezod.dynamics.fit_solution import PER_RESONANCE, Parts, Solution
from piezod.dynamics.measured import MeasuredResponse
from piezod.dynamics.poles import combinations_of_modes, possible_modes

RINGS_BELOW: Final = 0.5
"""Damping ratio below which a resonance is a mode of the mechanics, and no filter."""
BETTER: Final = 10.0
"""Another explanation of the lines must lower the criterion by this: strong evidence."""
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
        self._used, self.gains, self._rate_hz = tuple(used), len(used), rate_hz
        self._lines = FitLines(used, rate_hz)
        self.signs, self.residuals = self._lines.signs, 2 * self._lines.count
        self._fastest_filter_hz = np.inf if rate_hz is None else FASTEST_FILTER * rate_hz

    def best(self, count: int, before: Solution | None) -> Solution | None:
        """Return the best solution with a number of resonances; None if nothing hints at them.

        Args:
            count: The number.
            before: A solution with one resonance fewer, to start from too.
        """
        starts = sorted(self._starts(count), key=self._start_cost)
        after = list(self._starts_after(before)) if before else []
        plain, folded = (
            # A weak filter is never close to the lines, so all of these are tried.
            self._best_of(
                [
                    *self._which_above(starts, above=above)[:_REFINED],
                    *self._which_above(after, above=above),
                ]
            )
            for above in (False, True)
        )
        if plain is None or folded is None:
            return plain or folded
        # A sharp mode whose image is at that of the lines explains them about as well as theirs.
        parts = folded.parts
        sharp = parts.dampings[parts.frequencies_hz > 0.5 * (self._rate_hz or np.inf)] < SHARP
        better = self.criterion(plain) - self.criterion(folded) > BETTER
        return folded if better and not np.any(sharp) else plain

    def _best_of(self, starts: Sequence[FloatArray]) -> Solution | None:
        # Several approximations of the lines have the same poles.
        solved = [
            self._solve(start) for start in {each.tobytes(): each for each in starts}.values()
        ]
        return min(solved, key=lambda each: each.cost, default=None)

    def _which_above(self, starts: Sequence[FloatArray], *, above: bool) -> list[FloatArray]:
        """Return the starts with a mode above half of the rate, or those without."""
        return [each for each in starts if self._is_above(each) == above]

    def _is_above(self, start: FloatArray) -> bool:
        parts = Parts.of(start, self._lines.fixed)
        above = parts.frequencies_hz > 0.5 * (self._rate_hz or np.inf)
        return bool(np.any(above & (parts.dampings < RINGS_BELOW)))

    @cached_property
    def _undelayed(self) -> list[tuple[float, FloatArray, ComplexArray]]:
        """Delays to start from, in s; lines in Hz, and their response without such a delay."""
        lines = max(self._used, key=lambda each: each.frequency_hz.size)
        f, response = lines.frequency_hz, self.signs[self._used.index(lines)] * lines.response
        half = slice(0, f.size // 2 + 1)
        slope = -np.polyfit(f[half], np.unwrap(np.angle(response[half])), 1)[0] / (2.0 * np.pi)
        delays_s = np.linspace(0.0, max(slope, 0.0), _DELAYS).tolist()
        return [(each_s, f, response * np.exp(2j * np.pi * f * each_s)) for each_s in delays_s]

    @cached_property
    def _possible(self) -> list[list[FloatArray]]:
        """Modes that each undelayed response hints at."""
        return [possible_modes(f, undelayed) for _, f, undelayed in self._undelayed]

    def _starts(self, count: int) -> Iterator[FloatArray]:
        """Yield parameters to start from."""
        heads = [[*np.log(self._lines.gain), 0.0, 0.0, 1e3 * each] for each, *_ in self._undelayed]
        if not count:
            yield from map(np.array, heads)
            return
        for head, (_, f, undelayed), possible in zip(
            heads, self._undelayed, self._possible, strict=True
        ):
            for modes in combinations_of_modes(possible, count, self._rate_hz):
                basis = second_order(f / modes[:, :1], modes[:, 1])
                weights, *_ = np.linalg.lstsq(real(basis).T, real(undelayed), rcond=None)
                shares = np.clip(weights / (weights.sum() or 1.0), *_SHARES)
                yield np.array([*head, *np.log(modes).ravel(), *shares[:-1]])

    def _starts_after(self, before: Solution) -> Iterator[FloatArray]:
        """Yield the parameters of a solution with a weak filter more, in front of the others."""
        parts = before.parts
        own = np.log(np.stack((parts.frequencies_hz, parts.dampings), axis=1)).ravel()
        for frequency_hz in np.geomspace(self._lines.low_hz, self._lines.high_hz, _FILTERS + 2)[2:]:
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
        parts, known = solution.parts, self._known(solution)
        is_mode = parts.dampings < RINGS_BELOW
        highest_hz = np.where(is_mode, self._lines.high_hz, self._fastest_filter_hz)
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
        parts = solution.parts
        is_mode = (parts.dampings < RINGS_BELOW) & self._known(solution)
        above = parts.frequencies_hz > 0.5 * (self._rate_hz or np.inf)
        inside = parts.frequencies_hz < self._lines.high_hz
        return bool(np.any(is_mode & above) and not np.any(is_mode & inside))

    def _known(self, solution: Solution) -> npt.NDArray[np.bool_]:
        """Return which resonances are determined, in frequency and share, shape (n,)."""
        parts, uncertain = solution.parts, self.uncertainties(solution)
        known = uncertain.frequencies_hz < KNOWN * parts.frequencies_hz
        return known & (np.abs(parts.shares) > SIGNIFICANT * uncertain.shares)

    def uncertainties(self, solution: Solution) -> Parts:
        """Return the standard uncertainties of a solution's parameters."""
        jacobian, own_end = solution.jacobian, self._lines.fixed + 2 * solution.count
        freedom = max(jacobian.shape[0] - jacobian.shape[1], 1)
        # The scatter about the fit counts, if it is larger than the measured one.
        scale = max(1.0, 2.0 * solution.cost / freedom)
        covariance = scale * np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
        single = np.sqrt(np.diag(covariance))
        parts = solution.parts
        # The last share is one minus the others.
        last = np.sqrt(max(float(covariance[own_end:, own_end:].sum()), 0.0))
        return Parts(
            single[: self._lines.fixed],
            parts.frequencies_hz * single[self._lines.fixed : own_end : 2],
            parts.dampings * single[self._lines.fixed + 1 : own_end : 2],
            np.append(single[own_end:], last) if solution.count else np.empty(0),
        )

    def _within(self, start: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
        """Return a start within the bounds, and the bounds."""
        lines, count = self._lines, Parts.of(start, self._lines.fixed).shares.size
        limits = [
            *np.log(lines.gain)[:, None] + np.log(_GAINS),
            *(_PHASES, _CREEPS, (0.0, 1e3 * LONGEST_DELAY_S)),
            *([np.log((lines.low_hz, BEYOND * lines.high_hz)), np.log(_DAMPINGS)] * count),
            *([_SHARES] * max(count - 1, 0)),
        ]
        low, high = np.array(limits).T
        return np.clip(start, low, high), (low, high)

    def _start_cost(self, start: FloatArray) -> float:
        within, _ = self._within(start)
        return float(np.sum(self._lines.distance(within) ** 2))

    def _solve(self, start: FloatArray) -> Solution:
        within, bounds = self._within(start)
        found = least_squares(
            self._lines.distance,
            within,
            self._lines.derivatives,
            bounds=bounds,
            x_scale="jac",
            ftol=1e-6,
            max_nfev=_STEPS,
        )
        parts = Parts.of(found.x, self._lines.fixed)
        return Solution(found.x, parts, float(found.cost), np.asarray(found.jac))
