"""Fits a surface, creep and the delay to a record, all at once: the forward form of identification.

The displacement follows from the drive, which is known without noise:

    x(t) = y + Σ w_k L_k[y] + offset,   y = H[z] + p (v - z),   v = v(t - delay).

z is the drive that lags behind v with the rate, see `rate_lag`. The displacement is linear in the
coefficients of H and in the prompt slope p, in the weights of the lags for fixed coefficients, and
in the offset. The fit is repeated around its last result (Gauss-Newton), each time as one
constrained problem: every branch has a positive slope on every loop, see `everett_bounds`, and
neither a weight of a lag nor the activation is negative. The delay has either sign: a record may
tell its samples too early.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.experiment.fit.creep_regressors import lags_of, with_creep
from piezod.experiment.fit.record import Rows
from piezod.hysteresis import LEAST_SLOPE
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.everett_bounds import slope_rows
from piezod.hysteresis.least_squares import minimise, parameter_covariance
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.surface_form import surface_regressors

RIDGE = 1e-6
"""Penalty on the coefficients, relative to the mean power of their regressors."""
CREEP_RIDGE = 1e-2
"""Penalty on differences between the weights of lags: without information they are all equal, which
is creep that grows with the logarithm of time."""
_ROUNDS = 12
_SETTLED = 1e-5
LARGEST_LAG = 0.1
"""Largest weight of a lag, as in a model file."""

DrivesAt: TypeAlias = Callable[[float], FloatArray]
"""Returns the normalised drives of a record, delayed by a time in s, shape (n,)."""
PROMPT, CREEP = SIZE, SIZE + 1
OFFSET = CREEP + TIME_CONSTANTS_S.size
DELAY, ACTIVATION, COUNT = OFFSET + 1, OFFSET + 2, OFFSET + 3
"""Places of the prompt slope, the first lag, the offset, the delay and the activation behind the 24
coefficients, and the number of all parameters."""
START_ACTIVATION, LARGEST_ACTIVATION = 0.003, 0.05
_ACTIVATION_STEP = 2e-4


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
        regressors: (n, 36) regressors of all parameters.
        target: (n,) values that they must add up to.
        counted: (n,) mask of the rows that count.
        fixed: (36,) mask of the parameters that are not searched.
        parameters: (36,) solution; the delay is in sample periods.
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
        """Return the covariance of the parameters without active constraints, shape (36, 36).

        Args:
            residual_variance: Mean squared residual per independent sample.
        """
        rows, free = self.regressors[self.counted], ~self.fixed
        covariance = np.zeros((free.size, free.size))
        gram = _penalised(rows[:, free], free)
        covariance[np.ix_(free, free)] = parameter_covariance(gram, residual_variance)
        return covariance

    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit these rows best, shape (36,)."""
        return _solved(self.regressors[rows], self.target[rows], self.parameters, self.fixed)


def fit_surface(
    record: SurfaceRecord,
    *,
    creep: bool,
    delay_s: float | None,
    start_delay_s: float,
    rate: bool = False,
) -> LinearisedSurface:
    """Fit the coefficients and the offset, and the creep and the delay if requested.

    Args:
        record: The record.
        creep: Whether the lags of the creep are fitted.
        delay_s: Delay of the displacement behind the drive, in s; None if it is fitted.
        start_delay_s: Delay at which the search begins, in s.
        rate: Whether the lag that grows with the rate is fitted.

    Raises:
        ModelError: If the record does not determine the coefficients.
    """
    fixed = np.zeros(COUNT, dtype=np.bool_)
    fixed[CREEP:OFFSET] = not creep
    fixed[DELAY] = delay_s is not None
    fixed[[PROMPT, ACTIVATION]] = not rate
    parameters = np.zeros(COUNT)
    parameters[ACTIVATION] = START_ACTIVATION if rate else 0.0
    parameters[DELAY] = (start_delay_s if delay_s is None else delay_s) / record.period_s
    parameters = _first(record, parameters, fixed)
    for _ in range(_ROUNDS):
        around = _around(record, parameters, fixed)
        moved = np.max(np.abs(around.parameters[CREEP:] - parameters[CREEP:]))
        parameters = around.parameters
        if moved < _SETTLED:
            break
    return _around(record, parameters, fixed)


def _first(record: SurfaceRecord, parameters: FloatArray, fixed: Rows) -> FloatArray:
    """Return the best coefficients and prompt slope for the other parameters."""
    regressors = np.zeros((record.positions.size, COUNT))
    regressors[:, : PROMPT + 1] = _quick(record, parameters)
    regressors[:, OFFSET] = 1.0
    rest = fixed.copy()
    rest[[*range(CREEP, OFFSET), DELAY, ACTIVATION]] = True
    counted = record.counted
    return _solved(regressors[counted], record.positions[counted], parameters, rest)


def _quick(record: SurfaceRecord, parameters: FloatArray) -> FloatArray:
    """Return the regressors of coefficients and prompt slope without creep, shape (n, 25)."""
    drives = record.drives_at(float(parameters[DELAY]) * record.period_s)
    return surface_regressors(drives, float(parameters[ACTIVATION]), record.period_s)


def _around(record: SurfaceRecord, parameters: FloatArray, fixed: Rows) -> LinearisedSurface:
    """Return the problem around a point, and its solution."""
    period_s, weights = record.period_s, parameters[CREEP:OFFSET]
    shape = parameters[: PROMPT + 1]
    quick = _quick(record, parameters)
    y = quick @ shape
    regressors = np.zeros((record.positions.size, COUNT))
    regressors[:, : PROMPT + 1] = with_creep(quick, weights, period_s, from_rest=record.from_rest)
    lags = lags_of(y, period_s, from_rest=record.from_rest)
    regressors[:, CREEP:OFFSET] = lags
    regressors[:, OFFSET] = 1.0
    # A delay of one period more shifts the displacement by its change per sample.
    regressors[:, DELAY] = -np.gradient(regressors[:, : PROMPT + 1] @ shape)
    if not fixed[ACTIVATION]:
        moved = parameters + _ACTIVATION_STEP * np.eye(COUNT)[ACTIVATION]
        change = (_quick(record, moved) @ shape - y) / _ACTIVATION_STEP
        column = with_creep(change[:, np.newaxis], weights, period_s, from_rest=record.from_rest)
        regressors[:, ACTIVATION] = column[:, 0]
    bent = regressors[:, [DELAY, ACTIVATION]] @ parameters[[DELAY, ACTIVATION]]
    target = record.positions + lags @ weights + bent
    counted = record.counted
    found = _solved(regressors[counted], target[counted], parameters, fixed)
    return LinearisedSurface(regressors, target, counted, fixed, found)


def _solved(
    regressors: FloatArray, target: FloatArray, known: FloatArray, fixed: Rows
) -> FloatArray:
    """Solve one linear problem for the parameters that are not fixed; the others stay."""
    free = ~fixed
    rows, rest = regressors[:, free], target - regressors[:, fixed] @ known[fixed]
    constraints, bounds = _constraints()
    gram = _penalised(rows, free)
    needed = constraints[:, free].any(axis=1)
    found = known.copy()
    found[free] = minimise(gram, rows.T @ rest, constraints[needed][:, free], bounds[needed])
    # The solver keeps the constraints up to rounding; this keeps the signs exactly.
    positive = [PROMPT, *range(CREEP, OFFSET), ACTIVATION]
    found[positive] = np.maximum(found[positive], 0.0)
    return found


def _constraints() -> tuple[FloatArray, FloatArray]:
    """Return A and b for which A p ≥ b, shapes (k, 36) and (k,)."""
    slopes, signed = slope_rows(), np.eye(COUNT)[[PROMPT, *range(CREEP, OFFSET), ACTIVATION]]
    largest = -np.eye(COUNT)[[*range(CREEP, OFFSET), ACTIVATION]]
    rows = np.vstack((np.pad(slopes, ((0, 0), (0, COUNT - SIZE))), signed, largest))
    bounds = np.concatenate(
        (
            np.full(len(slopes), LEAST_SLOPE),
            np.zeros(len(signed)),
            np.full(len(largest) - 1, -LARGEST_LAG),
            [-LARGEST_ACTIVATION],
        )
    )
    return rows, bounds


def _penalised(rows: FloatArray, free: Rows) -> FloatArray:
    """Return the Gram matrix of the free parameters, with penalties."""
    gram = rows.T @ rows
    power = np.zeros(COUNT)
    power[free] = np.diag(gram)
    # A parameter without effect keeps its value: the prompt slope, if nothing lags.
    penalties = np.diag(1e-9 * np.maximum(power, 1e-6 * power.max()))
    penalties[:SIZE, :SIZE] += RIDGE * float(np.mean(power[:SIZE])) * np.eye(SIZE)
    if free[CREEP]:
        count = OFFSET - CREEP
        differences = np.eye(count) - 1.0 / count
        mean = float(np.mean(power[CREEP:OFFSET]))
        penalties[CREEP:OFFSET, CREEP:OFFSET] += CREEP_RIDGE * mean * differences
    return gram + penalties[np.ix_(free, free)]
