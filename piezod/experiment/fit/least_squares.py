"""Least squares over a whole record: weights, and with them creep, where that is asked for.

The drive that the model predicts is linear in its weights. It is not in what creeps, so that the
fit is repeated around its last result (Gauss and Newton), each time as one constrained problem.

With y the displacement without creep, normalised so that the largest drive belongs to y = 1:

    y = (1 + stretch) (x - creep) - offset

The offset is what the stage has drifted by since it was zeroed, in the run-in.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from piezod.control.law.creep import NO_CREEP, logarithmic
from piezod.errors import DataError, ModelError
from piezod.experiment.fit.prediction import without_creep
from piezod.experiment.fit.record import Rows
from piezod.hysteresis import stop_regressors
from piezod.hysteresis.least_squares import parameter_covariance, ridge_penalty, solve_constrained
from piezod.hysteresis.memory import FloatArray

RIDGE = 1e-6
"""Penalty on the weights, relative to the mean power of their regressors."""
_ROUNDS = 12
_STEP = 1e-4  # for differences
_SETTLED = 1e-5
_FARTHEST = 0.5  # of the range
_MOST_CREEP = 0.1  # weight of each lag: with all eight, most of a displacement would be creep
_PARTS = (1.0, 0.5, 0.25, 0.125)  # of a step


class Slow(NamedTuple):
    """How the measured displacement becomes that of the hysteresis, y.

    Attributes:
        creep: Weight of each lag.
        offset: Drift, in units of the range.
        stretch: Growth of the range's unit.
    """

    creep: float = 0.0
    offset: float = 0.0
    stretch: float = 0.0


@dataclass(frozen=True)
class Series:
    """A record, normalised and aligned.

    Attributes:
        positions: (n,) displacement, in units of its range.
        drives: (n,) voltage that it answers to, in units of its range.
        period_s: Time from sample to sample, in s.
        from_rest: Whether the stage had rested where it begins.
        counted: (n,) which samples count; the others only carry the memory on.
    """

    positions: FloatArray
    drives: FloatArray
    period_s: float
    from_rest: bool
    counted: Rows

    def quick(self, slow: Slow) -> FloatArray:
        """Return y, shape (n,)."""
        x = (1.0 + slow.stretch) * self.positions - slow.offset
        law = logarithmic(slow.creep) if slow.creep else NO_CREEP
        return without_creep(x, law, self.period_s, from_rest=self.from_rest)


_MUCH = Slow(creep=0.01, stretch=0.04)  # two per cent a decade

SeriesAt: TypeAlias = Callable[[float], Series]
"""Gives a record aligned by a delay in s."""


@dataclass(frozen=True)
class Linearised:
    """The problem as it is around its solution: linear in everything that is looked for.

    Attributes:
        bank: (2, 2 M) of the stops.
        regressors: (n, 2 M + E) of the weights and of what is slow.
        target: (n,) what they have to add up to.
        counted: (n,) which rows count.
        parameters: (2 M + E,) the solution.
    """

    bank: FloatArray
    regressors: FloatArray
    target: FloatArray
    counted: Rows
    parameters: FloatArray

    @property
    def misses(self) -> FloatArray:
        """Predicted minus actual drive in units of its range, shape (n,)."""
        return self.regressors @ self.parameters - self.target

    def covariance(self, residual_variance: float) -> FloatArray:
        """Return the covariance of the parameters as if no constraint bound, shape (p, p).

        Args:
            residual_variance: Mean squared residual for each independent sample.
        """
        gram = _penalised_gram(self.bank, self.regressors[self.counted])
        return parameter_covariance(gram, residual_variance)

    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit some of the rows best, shape (2 M + E,)."""
        return _solve(self.bank, self.regressors[rows], self.target[rows])


class LeastSquaresFit(NamedTuple):
    """What was found.

    Attributes:
        weights: (2 M,) weights [a^l, a^r].
        slow: What creeps and drifts; nothing where that was not asked for.
        linearised: The problem around this solution.
    """

    weights: FloatArray
    slow: Slow
    linearised: Linearised


def fit_least_squares(bank: FloatArray, series: Series, *, creep: bool) -> LeastSquaresFit:
    """Fit weights, and creep if asked for.

    Args:
        bank: (2, 2 M) of the stops.
        series: The record.
        creep: Whether creep, offset and stretch are fitted too.

    Raises:
        DataError: If the search for the creep goes astray.
    """
    point = _Point.at(bank, series, Slow())
    if not creep:
        return LeastSquaresFit(point.linear.parameters, point.slow, point.linear)
    point, _ = _search(bank, lambda _: series, point, 0.0, with_delay=False)
    slow = point.slow
    if not slow.creep <= _MOST_CREEP:
        raise DataError(
            f"no creep could be fitted: the search went to {slow.creep:.2g} for each lag, allowed "
            f"is up to {_MOST_CREEP:g}; fit without creep, or record for longer"
        )
    if not (abs(slow.stretch) < _FARTHEST and abs(slow.offset) < _FARTHEST):
        raise DataError(
            f"no creep could be fitted: the search went to a stretch of {slow.stretch:.2g} and an "
            f"offset of {slow.offset:.2g} of the range; fit without creep, or record for longer"
        )
    return LeastSquaresFit(point.linear.parameters, slow, _around(bank, point, with_delay=False))


def search_delay(bank: FloatArray, series_at: SeriesAt) -> Slow:
    """Return what creeps, searched together with the delay.

    One after the other they would mislead each other, since fast creep looks like a delay. The
    search begins without delay, since one that is too long hides the creep, and both without creep
    and with much of it.

    Args:
        bank: (2, 2 M) of the stops.
        series_at: Gives the record aligned by a delay in s.
    """
    series, found = series_at(0.0), []
    for start in (Slow(), _MUCH):
        point = _Point.at(bank, series, start)
        found.append(_search(bank, series_at, point, 0.0, with_delay=True)[0])
    return min(found, key=lambda point: point.rms).slow


class _Point(NamedTuple):
    """The best weights for what creeps, and how good they are."""

    series: Series
    slow: Slow
    linear: Linearised
    rms: float

    @classmethod
    def at(cls, bank: FloatArray, series: Series, slow: Slow) -> "_Point":
        y = np.clip(series.quick(slow), 0.0, 1.0)
        linear = _solved(bank, stop_regressors(bank, y), series.drives - y, series.counted)
        return cls(
            series, slow, linear, float(np.sqrt(np.mean(linear.misses[series.counted] ** 2)))
        )


def _search(
    bank: FloatArray, series_at: SeriesAt, point: _Point, delay_s: float, *, with_delay: bool
) -> tuple[_Point, float]:
    """Search downhill from a point (Gauss and Newton), in half the step where that went up."""
    n_weights = bank.shape[1]
    for _ in range(_ROUNDS):
        parameters = _around(bank, point, with_delay=with_delay).parameters[n_weights:]
        later_s = float(parameters[-1]) * point.series.period_s if with_delay else 0.0
        step = parameters[: len(point.slow)] - np.array(point.slow)
        for part in _PARTS:
            there_s = max(0.0, delay_s + part * later_s)
            slow = Slow(*(np.array(point.slow) + part * step))
            there = _Point.at(bank, series_at(there_s), slow)
            if there.rms < point.rms:
                break
        else:
            break
        point, delay_s = there, there_s
        if np.max(np.abs(step)) < _SETTLED:
            break
    return point, delay_s


def _around(bank: FloatArray, point: _Point, *, with_delay: bool) -> Linearised:
    """Return the problem around a point, linear in what creeps too, and in one period of delay."""
    series, slow = point.series, point.slow
    drives = series.drives + point.linear.misses
    columns = []
    for i in range(len(slow)):
        moved = Slow(*(value + _STEP * (i == j) for j, value in enumerate(slow)))
        y = np.clip(series.quick(moved), 0.0, 1.0)
        there = y + stop_regressors(bank, y) @ point.linear.parameters
        columns.append((there - drives) / _STEP)
    target = point.linear.target + np.stack(columns, axis=1) @ np.array(slow)
    if with_delay:
        columns.append(np.gradient(series.drives))
    regressors = np.column_stack([point.linear.regressors, *columns])
    return _solved(bank, regressors, target, series.counted)


def _solved(
    bank: FloatArray, regressors: FloatArray, target: FloatArray, counted: Rows
) -> Linearised:
    parameters = _solve(bank, regressors[counted], target[counted])
    return Linearised(bank, regressors, target, counted, parameters)


def _solve(bank: FloatArray, regressors: FloatArray, target: FloatArray) -> FloatArray:
    """Solve one linear problem; creep, where it is looked for, is not negative."""
    n_weights = bank.shape[1]
    nonnegative = (n_weights,) if regressors.shape[1] > n_weights else ()
    gram = _penalised_gram(bank, regressors)
    return solve_constrained(gram, regressors.T @ target, bank, nonnegative=nonnegative)


def _penalised_gram(bank: FloatArray, regressors: FloatArray) -> FloatArray:
    n_weights = bank.shape[1]
    gram = regressors.T @ regressors
    penalties = 1e-9 * np.diag(gram)
    try:
        penalties[:n_weights] = ridge_penalty(gram[:n_weights, :n_weights], RIDGE)
    except ModelError as error:  # the record is to blame, and whoever reads it says so
        raise DataError(str(error)) from error
    return gram + np.diag(penalties)
