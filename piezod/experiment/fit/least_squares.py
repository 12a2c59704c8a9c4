"""Least squares over a whole record: the weights, and with them the creep, if requested.

The drive of the model is linear in its weights, paper eq. (16). It is not linear in the slow
parameters, so that the fit is repeated around its last result (Gauss-Newton), each time as one
constrained problem. The slow parameters are beyond the paper.

With y the displacement without creep, normalised so that the largest drive belongs to y = 1:

    y = (1 + stretch) (x - creep) - offset

The offset is the drift of the stage between its zero and the end of the run-in.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from piezod.control.law.creep import LAGS_PER_DECADE, NO_CREEP, logarithmic
from piezod.errors import DataError, ModelError
from piezod.experiment.fit.prediction import without_creep
from piezod.experiment.fit.record import Rows
from piezod.hysteresis import stop_regressors
from piezod.hysteresis.least_squares import parameter_covariance, ridge_penalty, solve_constrained
from piezod.hysteresis.memory import FloatArray

RIDGE = 1e-6
"""Penalty on the weights, relative to the mean power of their regressors."""
_ROUNDS = 12
_STEP = 1e-4  # step of the differences
_SETTLED = 1e-5
_MAX_DRIFT = 0.5  # limit of offset and stretch, in units of the range
_MAX_CREEP = 0.1  # limit for each lag: all eight would make most of a displacement
_PARTS = (1.0, 0.5, 0.25, 0.125)  # fractions of a step that are tried


class SlowParameters(NamedTuple):
    """Parameters of the map from the measured displacement to that of the hysteresis, y.

    Attributes:
        creep: Weight of each lag.
        offset: Drift, in units of the range.
        stretch: Relative growth of the range.
    """

    creep: float = 0.0
    offset: float = 0.0
    stretch: float = 0.0


@dataclass(frozen=True)
class Series:
    """A normalised record with aligned drive.

    Attributes:
        positions: (n,) displacement, in units of its range.
        drives: (n,) voltage that belongs to it, in units of its range.
        period_s: Sample period, in s.
        from_rest: Whether the stage had rested before the record.
        counted: (n,) mask of the samples that count; the others only advance the memory.
    """

    positions: FloatArray
    drives: FloatArray
    period_s: float
    from_rest: bool
    counted: Rows

    def quick(self, slow: SlowParameters) -> FloatArray:
        """Return y, shape (n,)."""
        x = (1.0 + slow.stretch) * self.positions - slow.offset
        law = logarithmic(slow.creep) if slow.creep else NO_CREEP
        return without_creep(x, law, self.period_s, from_rest=self.from_rest)


_MUCH_CREEP = SlowParameters(creep=0.01, stretch=0.04)  # 2 % per decade

SeriesAt: TypeAlias = Callable[[float], Series]
"""Returns a record aligned by a delay in s."""


@dataclass(frozen=True)
class Linearised:
    """The problem around its solution: linear in all parameters.

    Attributes:
        bank: (2, 2 M) thresholds and gains of the stops.
        regressors: (n, 2 M + E) regressors of the weights and of the slow parameters.
        target: (n,) values that they must add up to.
        counted: (n,) mask of the rows that count.
        parameters: (2 M + E,) solution.
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

    @property
    def drive_changes(self) -> FloatArray:
        """Ones, shape (n,): the predicted value is the drive."""
        return np.ones(self.target.size)

    @property
    def creep_gradient(self) -> FloatArray | None:
        """Change of the creep per decade with each parameter, shape (p,); None without creep."""
        n_weights = self.bank.shape[1]
        if self.parameters.size == n_weights:
            return None
        # One parameter is the weight of every lag.
        return LAGS_PER_DECADE * np.eye(self.parameters.size)[n_weights]

    def covariance(self, residual_variance: float) -> FloatArray:
        """Return the covariance of the parameters without active constraints, shape (p, p).

        Args:
            residual_variance: Mean squared residual per independent sample.
        """
        gram = _penalised_gram(self.bank, self.regressors[self.counted])
        return parameter_covariance(gram, residual_variance)

    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit these rows best, shape (2 M + E,)."""
        return _solve(self.bank, self.regressors[rows], self.target[rows])


class LeastSquaresFit(NamedTuple):
    """Result of a fit.

    Attributes:
        weights: (2 M,) weights [a^l, a^r].
        slow: Slow parameters; zero if they were not requested.
        linearised: The problem around this solution.
    """

    weights: FloatArray
    slow: SlowParameters
    linearised: Linearised


def fit_least_squares(bank: FloatArray, series: Series, *, creep: bool) -> LeastSquaresFit:
    """Fit the weights, and the slow parameters if requested.

    Args:
        bank: (2, 2 M) thresholds and gains of the stops.
        series: The record.
        creep: Whether creep, offset and stretch are fitted, too.

    Raises:
        DataError: If the search for the creep does not converge to a plausible result.
    """
    point = _Point.at(bank, series, SlowParameters())
    if not creep:
        return LeastSquaresFit(point.linear.parameters, point.slow, point.linear)
    point, _ = _search(bank, lambda _: series, point, 0.0, with_delay=False)
    slow = point.slow
    if not slow.creep <= _MAX_CREEP:
        raise DataError(
            f"no creep could be fitted: the search went to {slow.creep:.2g} for each lag, allowed "
            f"is up to {_MAX_CREEP:g}; fit without creep, or record for longer"
        )
    if not (abs(slow.stretch) < _MAX_DRIFT and abs(slow.offset) < _MAX_DRIFT):
        raise DataError(
            f"no creep could be fitted: the search went to a stretch of {slow.stretch:.2g} and an "
            f"offset of {slow.offset:.2g} of the range; fit without creep, or record for longer"
        )
    return LeastSquaresFit(point.linear.parameters, slow, _around(bank, point, with_delay=False))


def search_slow_parameters(bank: FloatArray, series_at: SeriesAt) -> SlowParameters:
    """Return the slow parameters, searched together with the delay.

    One after the other, each would falsify the other, because fast creep looks like a delay. The
    search starts without delay, because too long a delay hides the creep. It starts once without
    creep and once with much creep.

    Args:
        bank: (2, 2 M) thresholds and gains of the stops.
        series_at: Returns the record aligned by a delay in s.
    """
    series, found = series_at(0.0), []
    for start in (SlowParameters(), _MUCH_CREEP):
        point = _Point.at(bank, series, start)
        found.append(_search(bank, series_at, point, 0.0, with_delay=True)[0])
    return min(found, key=lambda point: point.rms).slow


class _Point(NamedTuple):
    """The best weights for given slow parameters, and their rms error."""

    series: Series
    slow: SlowParameters
    linear: Linearised
    rms: float

    @classmethod
    def at(cls, bank: FloatArray, series: Series, slow: SlowParameters) -> "_Point":
        y = np.clip(series.quick(slow), 0.0, 1.0)
        linear = _solved(bank, stop_regressors(bank, y), series.drives - y, series.counted)
        return cls(
            series, slow, linear, float(np.sqrt(np.mean(linear.misses[series.counted] ** 2)))
        )


def _search(
    bank: FloatArray, series_at: SeriesAt, point: _Point, delay_s: float, *, with_delay: bool
) -> tuple[_Point, float]:
    """Search downhill from a point (Gauss-Newton), with half the step if the error rises."""
    n_weights = bank.shape[1]
    for _ in range(_ROUNDS):
        parameters = _around(bank, point, with_delay=with_delay).parameters[n_weights:]
        delay_step_s = float(parameters[-1]) * point.series.period_s if with_delay else 0.0
        step = parameters[: len(point.slow)] - np.array(point.slow)
        for part in _PARTS:
            there_s = max(0.0, delay_s + part * delay_step_s)
            slow = SlowParameters(*(np.array(point.slow) + part * step))
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
    """Return the problem around a point, linear in the slow parameters and in the delay."""
    series, slow = point.series, point.slow
    drives = series.drives + point.linear.misses
    columns = []
    for i in range(len(slow)):
        # Derivative of the predicted drive to each slow parameter, by a small difference.
        moved = SlowParameters(*(value + _STEP * (i == j) for j, value in enumerate(slow)))
        y = np.clip(series.quick(moved), 0.0, 1.0)
        there = y + stop_regressors(bank, y) @ point.linear.parameters
        columns.append((there - drives) / _STEP)
    target = point.linear.target + np.stack(columns, axis=1) @ np.array(slow)
    if with_delay:
        # A delay of one period shifts the drive by its change per sample.
        columns.append(np.gradient(series.drives))
    regressors = np.column_stack([point.linear.regressors, *columns])
    return _solved(bank, regressors, target, series.counted)


def _solved(
    bank: FloatArray, regressors: FloatArray, target: FloatArray, counted: Rows
) -> Linearised:
    parameters = _solve(bank, regressors[counted], target[counted])
    return Linearised(bank, regressors, target, counted, parameters)


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
