"""Least squares over a whole record: the weights, and with them the creep, if requested.

The drive of the model is linear in its weights, paper eq. (16). It is not linear in the creep, so
that the fit is repeated around its last result (Gauss-Newton), each time as one constrained
problem. Creep is beyond the paper.

The displacement without creep is normalised by its own range, as eq. (28) does it without creep. A
range that is searched, too, is hardly determined by the drive: the weights make up for one that is
too large by branches that are flat at their ends. On a measured stage it was 1 % too large, and so
were the errors of the position just after each turn.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from piezod.control.law.creep import LAGS_PER_DECADE, NO_CREEP, TIME_CONSTANTS_S, logarithmic
from piezod.errors import DataError, ModelError
from piezod.experiment.fit.prediction import without_creep
from piezod.experiment.fit.problem import STEP_PARTS, LinearProblem, first_better
from piezod.experiment.fit.record import Rows
from piezod.hysteresis import AffineRange, stop_regressors
from piezod.hysteresis.least_squares import parameter_covariance, ridge_penalty, solve_constrained
from piezod.hysteresis.memory import FloatArray

RIDGE = 1e-6
"""Penalty on the weights, relative to the mean power of their regressors."""
_ROUNDS = 12
_STEP = 1e-4  # step of the differences
_SETTLED = 1e-5
_MAX_CREEP = 0.1  # limit for each lag: all eight would make most of a displacement


@dataclass(frozen=True)
class Series:
    """A normalised record with aligned drive."""

    positions: FloatArray  #: (n,) displacement, in units of its range.
    drives: FloatArray  #: (n,) voltage that belongs to it, in units of its range.
    period_s: float  #: Sample period, in s.
    from_rest: bool  #: Whether the stage had rested before the record.
    counted: Rows  #: (n,) mask of the samples that count; the others only advance the memory.
    #: (n,) mask of the samples whose range is that of the model: also those at the start whose
    #: voltage was not recorded, one delay before.
    after_run_in: Rows

    def quick(self, creep: float) -> FloatArray:
        """Return the displacement without creep, in units of its own range, shape (n,).

        The operators are defined on [0, 1]; samples that do not count may leave their range.

        Args:
            creep: Weight of each lag.
        """
        without = self._without(creep)
        return np.clip(self._range_of(without).to_unit(without), 0.0, 1.0)

    def range_of(self, creep: float) -> AffineRange:
        """Return the range of the displacement without creep, in units of that with creep.

        A constant has all its creep after a long rest: the zero of the range includes it.
        """
        quick = self._range_of(self._without(creep))
        low = quick.low * (1.0 + creep * TIME_CONSTANTS_S.size)
        return AffineRange.checked(low, low + quick.width)

    def _without(self, creep: float) -> FloatArray:
        law = logarithmic(creep) if creep else NO_CREEP
        return without_creep(self.positions, law, self.period_s, from_rest=self.from_rest)

    def _range_of(self, values: FloatArray) -> AffineRange:
        values = values[self.after_run_in]
        return AffineRange(float(values.min()), float(values.max()))


_MUCH_CREEP = 0.01  # 2 % per decade

SeriesAt: TypeAlias = Callable[[float], Series]
"""Returns a record aligned by a delay in s."""


@dataclass(frozen=True)
class LinearisedStops(LinearProblem):
    """The problem of stops around its solution; the predicted value is the drive.

    The parameters are the weights, then the creep and the delay, as far as they are searched.
    """

    bank: FloatArray  #: (2, 2 M) thresholds and gains of the stops.

    @property
    def drive_changes(self) -> FloatArray:
        """Ones, shape (n,)."""
        return np.ones(self.target.size)

    @property
    def creep_gradient(self) -> FloatArray | None:
        """Change of the creep per decade with each parameter."""
        n_weights = self.bank.shape[1]
        if self.parameters.size == n_weights:
            return None
        # One parameter is the weight of every lag.
        return LAGS_PER_DECADE * np.eye(self.parameters.size)[n_weights]

    def covariance(self, residual_variance: float) -> FloatArray:
        """Return the covariance of the parameters without active constraints."""
        gram = _penalised_gram(self.bank, self.regressors[self.counted])
        return parameter_covariance(gram, residual_variance)

    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit these rows best."""
        return _solve(self.bank, self.regressors[rows], self.target[rows])


class LeastSquaresFit(NamedTuple):
    """Result of a fit."""

    weights: FloatArray  #: (2 M,) weights [a^l, a^r].
    creep: float  #: Weight of each lag; zero if it was not requested.
    linearised: LinearisedStops  #: The problem around this solution.


def fit_least_squares(bank: FloatArray, series: Series, *, creep: bool) -> LeastSquaresFit:
    """Fit the weights, and the creep if requested.

    Args:
        bank: (2, 2 M) thresholds and gains of the stops.
        series: The record.
        creep: Whether creep is fitted, too.

    Raises:
        DataError: If the search for the creep does not converge to a plausible result.
    """
    if not creep:
        linear = _Point.at(bank, lambda _: series, 0.0, 0.0).linear
        return LeastSquaresFit(linear.parameters, 0.0, linear)
    point = _search(bank, lambda _: series, 0.0, with_delay=False)
    if not point.creep <= _MAX_CREEP:
        raise DataError(
            f"no creep could be fitted: the search went to {point.creep:.2g} for each lag, allowed "
            f"is up to {_MAX_CREEP:g}; fit without creep, or record for longer"
        )
    linearised = _around(bank, point, with_delay=False)
    return LeastSquaresFit(point.linear.parameters, point.creep, linearised)


def search_creep(bank: FloatArray, series_at: SeriesAt) -> float:
    """Return the weight of each lag of the creep, searched together with the delay.

    One after the other, each would falsify the other, because fast creep looks like a delay. The
    search starts without delay, because too long a delay hides the creep. It starts once without
    creep and once with much creep.

    Args:
        bank: (2, 2 M) thresholds and gains of the stops.
        series_at: Returns the record aligned by a delay in s.
    """
    found = [_search(bank, series_at, start, with_delay=True) for start in (0.0, _MUCH_CREEP)]
    return min(found, key=lambda point: point.rms).creep


class _Point(NamedTuple):
    """The best weights for a given delay and creep."""

    series: Series
    delay_s: float
    creep: float
    linear: LinearisedStops

    @classmethod
    def at(cls, bank: FloatArray, series_at: SeriesAt, delay_s: float, creep: float) -> "_Point":
        series = series_at(delay_s)
        y = series.quick(creep)
        linear = _solved(bank, stop_regressors(bank, y), series.drives - y, series.counted)
        return cls(series, delay_s, creep, linear)

    @property
    def rms(self) -> float:
        return self.linear.rms


def _search(bank: FloatArray, series_at: SeriesAt, creep: float, *, with_delay: bool) -> _Point:
    """Search downhill from a creep without delay (Gauss-Newton), in parts of a step if needed."""
    point = _Point.at(bank, series_at, 0.0, creep)
    for _ in range(_ROUNDS):
        parameters = _around(bank, point, with_delay=with_delay).parameters[bank.shape[1] :]
        delay_step_s = float(parameters[-1]) * point.series.period_s if with_delay else 0.0
        step = float(parameters[0]) - point.creep
        tried = (
            (max(0.0, point.delay_s + part * delay_step_s), point.creep + part * step)
            for part in STEP_PARTS
        )
        better = first_better(point, (_Point.at(bank, series_at, *each) for each in tried))
        if better is None:
            break
        point = better
        if abs(step) < _SETTLED:
            break
    return point


def _around(bank: FloatArray, point: _Point, *, with_delay: bool) -> LinearisedStops:
    """Return the problem around a point, linear in the creep and in the delay."""
    series, creep = point.series, point.creep
    drives = series.drives + point.linear.misses
    # Derivative of the predicted drive to the creep, by a small difference.
    y = series.quick(creep + _STEP)
    there = y + stop_regressors(bank, y) @ point.linear.parameters
    columns = [(there - drives) / _STEP]
    target = point.linear.target + columns[0] * creep
    if with_delay:
        # A delay of one period shifts the drive by its change per sample.
        columns.append(np.gradient(series.drives))
    regressors = np.column_stack([point.linear.regressors, *columns])
    return _solved(bank, regressors, target, series.counted)


def _solved(
    bank: FloatArray, regressors: FloatArray, target: FloatArray, counted: Rows
) -> LinearisedStops:
    parameters = _solve(bank, regressors[counted], target[counted])
    return LinearisedStops(regressors, target, counted, parameters, bank)


def _solve(bank: FloatArray, regressors: FloatArray, target: FloatArray) -> FloatArray:
    """Solve one linear problem; the creep, if it is searched, is not negative."""
    n_weights = bank.shape[1]
    nonnegative = (n_weights,) if regressors.shape[1] > n_weights else ()
    gram = _penalised_gram(bank, regressors)
    return solve_constrained(gram, regressors.T @ target, bank, nonnegative=nonnegative)


def _penalised_gram(bank: FloatArray, regressors: FloatArray) -> FloatArray:
    """Return the Gram matrix of the regressors, with the ridge penalty."""
    n_weights = bank.shape[1]
    gram = regressors.T @ regressors
    penalties = 1e-9 * np.diag(gram)
    try:
        penalties[:n_weights] = ridge_penalty(gram[:n_weights, :n_weights], RIDGE)
    except ModelError as error:  # the record is the cause: name the file in the text
        raise DataError(str(error)) from error
    return gram + np.diag(penalties)
