"""Fits a surface, creep and the delay to a record, all at once: the forward form of identification.

The displacement follows from the drive, which is known without noise:

    x(t) = H[v(t - delay)] + Σ w_k L_k[H] + offset.

It is linear in the coefficients of H, in the weights of the lags for fixed coefficients, and in the
offset. The fit is repeated around its last result (Gauss-Newton), each time as one constrained
problem: every branch has a positive slope on every loop, see `everett_bounds`, and no weight of a
lag is negative. The delay has either sign: a record may tell its samples too early.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.experiment.fit.record import Rows
from piezod.experiment.fit.surface_regressors import lags_of, surface_regressors, with_creep
from piezod.hysteresis import LEAST_SLOPE
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.everett_bounds import slope_rows
from piezod.hysteresis.least_squares import minimise, parameter_covariance
from piezod.hysteresis.memory import FloatArray

RIDGE = 1e-6
"""Penalty on the coefficients, relative to the mean power of their regressors."""
CREEP_RIDGE = 1e-2
"""Penalty on differences between the weights of lags: without information they are all equal, which
is creep that grows with the logarithm of time."""
_ROUNDS = 12
_SETTLED = 1e-5
_FEWEST_ROUNDS = 2

DrivesAt: TypeAlias = Callable[[float], FloatArray]
"""Returns the normalised drives of a record, delayed by a time in s, shape (n,)."""
CREEP, OFFSET, DELAY = SIZE, SIZE + TIME_CONSTANTS_S.size, SIZE + TIME_CONSTANTS_S.size + 1
"""Places of the first lag, the offset and the delay behind the 24 coefficients."""


@dataclass(frozen=True)
class SurfaceRecord:
    """A normalised record.

    Attributes:
        drives_at: The drives, delayed.
        positions: (n,) displacement, in units of its range.
        period_s: Sample period, in s.
        from_rest: Whether the stage had rested before the record.
        counted: (n,) mask of the samples that count; the others only advance the memory.
    """

    drives_at: DrivesAt
    positions: FloatArray
    period_s: float
    from_rest: bool
    counted: Rows


@dataclass(frozen=True)
class LinearisedSurface:
    """The problem around its solution: linear in all parameters.

    Attributes:
        regressors: (n, 34) regressors of the coefficients, the lags, the offset and the delay.
        target: (n,) values that they must add up to.
        counted: (n,) mask of the rows that count.
        fixed: (34,) mask of the parameters that are not searched.
        parameters: (34,) solution; the delay is in sample periods.
    """

    regressors: FloatArray
    target: FloatArray
    counted: Rows
    fixed: Rows
    parameters: FloatArray

    @property
    def misses(self) -> FloatArray:
        """Predicted minus measured displacement in units of its range, shape (n,)."""
        return self.regressors @ self.parameters - self.target

    def searched_but(self, place: int) -> Rows:
        """Return the mask of the parameters that are searched, without one."""
        searched = ~self.fixed
        searched[place] = False
        return searched

    def covariance(self, residual_variance: float) -> FloatArray:
        """Return the covariance of the parameters without active constraints, shape (34, 34).

        Args:
            residual_variance: Mean squared residual per independent sample.
        """
        rows, free = self.regressors[self.counted], ~self.fixed
        covariance = np.zeros((free.size, free.size))
        gram = _penalised(rows[:, free], free)
        covariance[np.ix_(free, free)] = parameter_covariance(gram, residual_variance)
        return covariance

    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit these rows best, shape (34,)."""
        return _solved(self.regressors[rows], self.target[rows], self.parameters, self.fixed)


def fit_surface(
    record: SurfaceRecord, *, creep: bool, delay_s: float | None, start_delay_s: float
) -> LinearisedSurface:
    """Fit the coefficients and the offset, and the creep and the delay if requested.

    Args:
        record: The record.
        creep: Whether the lags of the creep are fitted.
        delay_s: Delay of the displacement behind the drive, in s; None if it is fitted.
        start_delay_s: Delay at which the search begins, in s.

    Raises:
        ModelError: If the record does not determine the coefficients.
    """
    fixed = np.zeros(DELAY + 1, dtype=np.bool_)
    fixed[CREEP:OFFSET] = not creep
    fixed[DELAY] = delay_s is not None
    parameters = np.zeros(DELAY + 1)
    parameters[0] = 1.0  # displacement in proportion to the drive
    parameters[DELAY] = (start_delay_s if delay_s is None else delay_s) / record.period_s
    for round_ in range(_ROUNDS):
        around = _around(record, parameters, fixed)
        moved = np.max(np.abs(around.parameters[CREEP:] - parameters[CREEP:]))
        parameters = around.parameters
        if round_ >= _FEWEST_ROUNDS and moved < _SETTLED:
            break
    return _around(record, parameters, fixed)


def _around(record: SurfaceRecord, parameters: FloatArray, fixed: Rows) -> LinearisedSurface:
    """Return the problem around a point, and its solution."""
    period_s, weights = record.period_s, parameters[CREEP:OFFSET]
    quick = surface_regressors(record.drives_at(parameters[DELAY] * period_s))
    # Zeros: the first solution already multiplies the columns of the fixed parameters.
    regressors = np.zeros((record.positions.size, fixed.size))
    regressors[:, :SIZE] = with_creep(quick, weights, period_s, from_rest=record.from_rest)
    coefficients = parameters[:SIZE]
    if not coefficients[1:].any():  # the first round: any fit is a better point than a line
        start = np.array([True] * SIZE + [False] * (fixed.size - SIZE))
        rows = regressors[record.counted]
        target = record.positions[record.counted]
        coefficients = _solved(rows, target, parameters, ~start)[:SIZE]
    lags = lags_of(quick @ coefficients, period_s, from_rest=record.from_rest)
    regressors[:, CREEP:OFFSET] = lags
    regressors[:, OFFSET] = 1.0
    # A delay of one period more shifts the displacement by its change per sample.
    regressors[:, DELAY] = -np.gradient(regressors[:, :SIZE] @ coefficients)
    target = record.positions + lags @ weights + regressors[:, DELAY] * parameters[DELAY]
    counted = record.counted
    found = _solved(regressors[counted], target[counted], parameters, fixed)
    return LinearisedSurface(regressors, target, counted, fixed, found)


def _solved(
    regressors: FloatArray, target: FloatArray, known: FloatArray, fixed: Rows
) -> FloatArray:
    """Solve one linear problem for the parameters that are not fixed; the others stay."""
    free = ~fixed
    rows, rest = regressors[:, free], target - regressors[:, fixed] @ known[fixed]
    slopes, lags = slope_rows(), np.flatnonzero(free[CREEP:OFFSET])
    constraints = np.zeros((len(slopes) + lags.size, free.size))
    constraints[: len(slopes), :SIZE] = slopes
    constraints[len(slopes) + np.arange(lags.size), CREEP + lags] = 1.0
    bounds = np.append(np.full(len(slopes), LEAST_SLOPE), np.zeros(lags.size))
    gram = _penalised(rows, free)
    found = known.copy()
    found[free] = minimise(gram, rows.T @ rest, constraints[:, free], bounds)
    found[CREEP:OFFSET] = np.maximum(found[CREEP:OFFSET], 0.0)  # exactly
    return found


def _penalised(rows: FloatArray, free: Rows) -> FloatArray:
    """Return the Gram matrix of the free parameters, with penalties."""
    gram = rows.T @ rows
    power = np.diag(gram)
    penalties = np.zeros((free.size, free.size))
    penalties[:SIZE, :SIZE] = RIDGE * float(np.mean(power[:SIZE])) * np.eye(SIZE)
    if free[CREEP]:
        count = OFFSET - CREEP
        differences = np.eye(count) - 1.0 / count
        mean = float(np.mean(power[CREEP:OFFSET]))
        penalties[CREEP:OFFSET, CREEP:OFFSET] = CREEP_RIDGE * mean * differences
    return gram + penalties[np.ix_(free, free)] + 1e-9 * np.diag(power)
