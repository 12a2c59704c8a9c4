"""Fits a surface, creep and the delay to a record, all at once: the forward form of identification.

The displacement follows from the drive, which is known without noise:

    x(t) = y + Σ w_k L_k[y] + offset,   y = H[z] + p (v - z),   v = v(t - delay).

z is the drive that lags behind v with the rate, see `rate_lag`; p is the prompt slope. The lags of
the creep start from the displacement before the record, without its creep, as in `prediction`. The
displacement is linear in the coefficients of H and in p, and in the weights of the lags for fixed
coefficients. The fit is repeated around its last result (Gauss-Newton), each time as one
constrained problem: every branch has a positive slope on every loop, see `everett_bounds`, and the
weight of a lag is from 0 to `MAX_LAG`. Without that bound, the search may diverge on a record of
one frequency, because a lag of a sinusoid is a sinusoid. The delay has either sign: a record may
report its samples too early.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from piezod.control.law.creep import LAGS_PER_DECADE, TIME_CONSTANTS_S
from piezod.experiment.fit.creep_regressors import decays, lags_of, with_creep
from piezod.experiment.fit.record import Rows
from piezod.hysteresis import LEAST_SLOPE
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.everett_bounds import slope_rows
from piezod.hysteresis.least_squares import minimise, parameter_covariance
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.surface_form import branch_slopes, surface_regressors

RIDGE = 1e-6
"""Penalty on the coefficients, relative to the mean power of their regressors."""
CREEP_RIDGE = 1e-2
"""Penalty on differences between the weights of lags: without information they are all equal, which
is creep that grows with the logarithm of time."""
MAX_LAG = 0.1
"""Largest weight of a lag, as a share of the displacement; all lags together stay below 1."""
_ROUNDS = 12
_SETTLED = 1e-5
_PARTS = (1.0, 0.5, 0.25, 0.125)  # fractions of a step that are tried

DrivesAt: TypeAlias = Callable[[float], FloatArray]
"""Returns the normalised drives of a record, delayed by a time in s, shape (n,)."""
PROMPT, CREEP = SIZE, SIZE + 1
OFFSET = CREEP + TIME_CONSTANTS_S.size
DELAY, ACTIVATION, COUNT = OFFSET + 1, OFFSET + 2, OFFSET + 3
"""Places of the prompt slope, the first lag, the offset, the delay and the activation behind the 24
coefficients, and the number of all parameters."""
START_ACTIVATION, MAX_ACTIVATION = 0.003, 0.05
"""Activation at which its search begins, and the largest one, as shares of the drive's range."""
_ACTIVATION_STEP = 2e-4


@dataclass(frozen=True)
class SurfaceRecord:
    """A normalised record.

    Attributes:
        drives_at: The drives, delayed.
        positions: (n,) displacement, in units of its range.
        period_s: Sample period, in s.
        before: Displacement before the record, in the same unit.
        counted: (n,) mask of the samples that count; the others only advance the memory.
    """

    drives_at: DrivesAt
    positions: FloatArray
    period_s: float
    before: float
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
        drives: (n,) drives of the record, delayed.
        period_s: Sample period, in s.
    """

    regressors: FloatArray
    target: FloatArray
    counted: Rows
    fixed: Rows
    parameters: FloatArray
    drives: FloatArray
    period_s: float

    @property
    def misses(self) -> FloatArray:
        """Predicted minus measured displacement in units of its range, shape (n,)."""
        return self.regressors @ self.parameters - self.target

    @property
    def drive_changes(self) -> FloatArray:
        """Change of the drive per change of the displacement, both normalised, shape (n,)."""
        coefficients, activation = self.parameters[:SIZE], float(self.parameters[ACTIVATION])
        return 1.0 / branch_slopes(coefficients, self.drives, activation, self.period_s)

    @property
    def creep_gradient(self) -> FloatArray | None:
        """Change of the creep per decade with each parameter, shape (36,); None without creep."""
        if self.fixed[CREEP]:
            return None
        gradient = np.zeros(self.fixed.size)
        gradient[CREEP:OFFSET] = LAGS_PER_DECADE / TIME_CONSTANTS_S.size
        return gradient

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
    parameters[0] = 1.0  # displacement in proportion to the drive
    parameters[DELAY] = (start_delay_s if delay_s is None else delay_s) / record.period_s
    # First what is linear alone: any fit is a better start than a line.
    not_yet = np.ones_like(fixed)
    not_yet[:SIZE] = not_yet[OFFSET] = False
    not_yet[PROMPT] = not rate
    parameters = _around(record, parameters, not_yet).parameters
    rms = _Point.at(record, parameters).rms(record)
    for _ in range(_ROUNDS):
        step = _around(record, parameters, fixed).parameters - parameters
        for part in _PARTS:
            there = parameters + part * step
            rms_there = _Point.at(record, there).rms(record)
            if rms_there < rms:
                break
        else:
            break
        parameters, rms = there, rms_there
        if np.max(np.abs(step[CREEP:])) < _SETTLED:
            break
    return _around(record, parameters, fixed)


@dataclass(frozen=True)
class _Point:
    """A point of the search: parts of the displacement there.

    Attributes:
        drives: (n,) drives, delayed.
        quick: (n, 25) regressors of the coefficients and of the prompt slope, without creep.
        lags: (n, K) lags of the creep.
        started: (n,) creep that a start of all lags from one adds.
        start: Start of all lags.
        predicted: (n,) displacement.
    """

    drives: FloatArray
    quick: FloatArray
    lags: FloatArray
    started: FloatArray
    start: float
    predicted: FloatArray

    @classmethod
    def at(cls, record: SurfaceRecord, parameters: FloatArray) -> "_Point":
        """Return the point of these parameters, shape (36,)."""
        period_s, weights = record.period_s, parameters[CREEP:OFFSET]
        drives = record.drives_at(parameters[DELAY] * period_s)
        quick = surface_regressors(drives, float(parameters[ACTIVATION]), period_s)
        y = quick @ parameters[: PROMPT + 1]
        start = (record.before - float(parameters[OFFSET])) / (1.0 + float(np.sum(weights)))
        decay = decays(drives.size, period_s)
        lags = lags_of(y, period_s) + start * decay
        predicted = y + lags @ weights + parameters[OFFSET]
        return cls(drives, quick, lags, decay @ weights, start, predicted)

    def rms(self, record: SurfaceRecord) -> float:
        """Return the rms error, in units of the range."""
        return float(np.sqrt(np.mean((self.predicted - record.positions)[record.counted] ** 2)))


def _around(record: SurfaceRecord, parameters: FloatArray, fixed: Rows) -> LinearisedSurface:
    """Return the problem around a point, and its solution."""
    point, weights = _Point.at(record, parameters), parameters[CREEP:OFFSET]
    total = 1.0 + float(np.sum(weights))
    regressors = np.zeros((record.positions.size, COUNT))
    regressors[:, : PROMPT + 1] = with_creep(point.quick, weights, record.period_s)
    # The start of the lags changes with their weights and with the offset, too.
    regressors[:, CREEP:OFFSET] = point.lags - (point.start / total * point.started)[:, np.newaxis]
    regressors[:, OFFSET] = 1.0 - point.started / total
    # A delay of one period more shifts the displacement by its change per sample.
    regressors[:, DELAY] = -np.gradient(point.predicted)
    if not fixed[ACTIVATION]:
        there = _Point.at(record, parameters + _ACTIVATION_STEP * np.eye(COUNT)[ACTIVATION])
        regressors[:, ACTIVATION] = (there.predicted - point.predicted) / _ACTIVATION_STEP
    target = record.positions - point.predicted + regressors @ parameters
    counted = record.counted
    found = _solved(regressors[counted], target[counted], parameters, fixed)
    return LinearisedSurface(
        regressors, target, counted, fixed, found, point.drives, record.period_s
    )


def _solved(
    regressors: FloatArray, target: FloatArray, known: FloatArray, fixed: Rows
) -> FloatArray:
    """Solve one linear problem for the parameters that are not fixed; the others stay."""
    free = ~fixed
    rows, rest = regressors[:, free], target - regressors[:, fixed] @ known[fixed]
    constraints, bounds = _constraints()
    needed = constraints[:, free].any(axis=1)
    gram = _penalised(rows, free)
    found = known.copy()
    found[free] = minimise(gram, rows.T @ rest, constraints[needed][:, free], bounds[needed])
    # The solver keeps the bounds up to rounding; this keeps them exactly.
    found[CREEP:OFFSET] = np.clip(found[CREEP:OFFSET], 0.0, MAX_LAG)
    found[[PROMPT, ACTIVATION]] = np.maximum(found[[PROMPT, ACTIVATION]], 0.0)
    return found


def _constraints() -> tuple[FloatArray, FloatArray]:
    """Return A and b for which A p ≥ b, shapes (k, 36) and (k,)."""
    slopes, units = np.pad(slope_rows(), ((0, 0), (0, COUNT - SIZE))), np.eye(COUNT)
    lags, prompt, activation = units[CREEP:OFFSET], units[[PROMPT]], units[[ACTIVATION]]
    parts = [
        (slopes, LEAST_SLOPE),
        (lags, 0.0),
        (-lags, -MAX_LAG),
        (prompt, 0.0),
        (activation, 0.0),
        (-activation, -MAX_ACTIVATION),
    ]
    bounds = np.concatenate([np.full(len(rows), bound) for rows, bound in parts])
    return np.vstack([rows for rows, _ in parts]), bounds


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
