"""Fits a surface, creep and the delay to a record, all at once: the forward form of identification.

The displacement follows from the drive, which is known without noise:

    x(t) = M[y + Σ w_k L_k[y]] + offset,   y = H[z] + p (v - z) + w h[z],   v = v(t - delay).

z is the drive that lags behind v with the rate, see `rate_lag`; p is the prompt slope; h relaxes
along the path of the drive, see `path_relaxation`; M is the first mode, see `mode_search`. These
three are there only if the record shows them. The lags of the creep start from the displacement
before the record, without its creep, as in `prediction`. The displacement is linear in the
coefficients of H, in p and in w, and in the weights of the lags for fixed coefficients. The fit is
repeated around its last result (Gauss-Newton), each time as one constrained problem: every branch
has a positive slope on every loop, see `everett_bounds`, and the weight of a lag is from 0 to
`MAX_LAG`. Without that bound, the search may diverge on a record of one frequency, because a lag of
a sinusoid is a sinusoid. The delay has either sign: a record may report its samples too early.
"""

from dataclasses import dataclass, replace

import numpy as np

from piezod.control.law.creep import LAGS_PER_DECADE, TIME_CONSTANTS_S
from piezod.experiment.fit.creep_regressors import with_creep
from piezod.experiment.fit.mode_search import ModeGuess
from piezod.experiment.fit.record import Rows
from piezod.experiment.fit.surface_parameters import (
    ACTIVATION,
    COUNT,
    CREEP,
    DAMPING,
    DECAY,
    DELAY,
    FREQUENCY,
    MODE,
    MODE_LAG,
    OFFSET,
    PATH,
    PROMPT,
    SKEW,
    START_MODE_LAG,
    form_of,
    penalised,
    solved,
)
from piezod.experiment.fit.surface_point import Point, SurfaceRecord
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.least_squares import parameter_covariance
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.surface_form import branch_slopes

START_ACTIVATION = 0.003
"""Activation at which its search begins, as a share of the drive's range."""
START_DECAY = 4.0
"""Decay of the path at which its search begins, in 1/range."""
_ROUNDS = 12
_SETTLED = 1e-5
_PARTS = (1.0, 0.5, 0.25, 0.125)  # fractions of a step that are tried
_FORM_STEPS = {ACTIVATION: 2e-4, DECAY: 1e-3, SKEW: 1e-3}
_MODE_STEPS = {DELAY: 1e-3, FREQUENCY: 1e-6, DAMPING: 1e-5, MODE_LAG: 1e-3}
"""Steps of differences."""


@dataclass(frozen=True)
class LinearisedSurface:
    """The problem around its solution: linear in all parameters.

    Attributes:
        regressors: (n, 42) regressors of all parameters.
        target: (n,) values that they must add up to.
        counted: (n,) mask of the rows that count.
        fixed: (42,) mask of the parameters that are not searched.
        parameters: (42,) solution; the delay is in sample periods.
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
        form = form_of(self.parameters, self.period_s)
        return 1.0 / branch_slopes(self.parameters[:SIZE], self.drives, form)

    @property
    def creep_gradient(self) -> FloatArray | None:
        """Change of the creep per decade with each parameter, shape (42,); None without creep."""
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
        """Return the covariance of the parameters without active constraints, shape (42, 42).

        Args:
            residual_variance: Mean squared residual per independent sample.
        """
        rows, free = self.regressors[self.counted], ~self.fixed
        covariance = np.zeros((free.size, free.size))
        gram = penalised(rows[:, free], free)
        covariance[np.ix_(free, free)] = parameter_covariance(gram, residual_variance)
        return covariance

    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit these rows best, shape (42,)."""
        return solved(self.regressors[rows], self.target[rows], self.parameters, self.fixed)


def fit_surface(
    record: SurfaceRecord,
    *,
    creep: bool,
    delay_s: float | None,
    start_delay_s: float,
    rate: bool = False,
    path: bool = False,
    mode: ModeGuess | None = None,
) -> LinearisedSurface:
    """Fit the coefficients and the offset, and the creep and the delay if requested.

    Args:
        record: The record.
        creep: Whether the lags of the creep are fitted.
        delay_s: Delay of the displacement behind the drive, in s; None if it is fitted.
        start_delay_s: Delay at which the search begins, in s.
        rate: Whether the lag that grows with the rate is fitted.
        path: Whether the part that relaxes along the path is fitted.
        mode: First mode at which its search begins; None if none is fitted.

    Raises:
        ModelError: If the record does not determine the coefficients.
    """
    fixed = np.zeros(COUNT, dtype=np.bool_)
    fixed[CREEP:OFFSET] = not creep
    fixed[DELAY] = delay_s is not None
    fixed[[PROMPT, ACTIVATION]] = not rate
    fixed[[PATH, DECAY, SKEW]] = not path
    fixed[[*MODE]] = mode is None
    parameters = np.zeros(COUNT)
    parameters[ACTIVATION] = START_ACTIVATION if rate else 0.0
    parameters[DECAY] = START_DECAY if path else 0.0
    parameters[0] = 1.0  # displacement in proportion to the drive
    parameters[DELAY] = (start_delay_s if delay_s is None else delay_s) / record.period_s
    if mode is not None:
        parameters[[*MODE]] = mode.frequency, mode.damping, 0.0
    # First what is linear alone: any fit is a better start than a line.
    not_yet = np.ones_like(fixed)
    not_yet[:SIZE] = not_yet[OFFSET] = False
    not_yet[PROMPT], not_yet[PATH] = not rate, not path
    parameters = _around(record, parameters, not_yet).parameters
    # A mode first without its lag: from far away, the lag would take its place.
    fixed[MODE_LAG] = True
    found = _searched(record, parameters, fixed)
    if mode is None:
        return found
    with_lag = found.parameters.copy()
    with_lag[MODE_LAG] = START_MODE_LAG
    fixed = fixed.copy()
    fixed[MODE_LAG] = False
    lagging = _searched(record, with_lag, fixed)
    both = [Point.at(record, each.parameters).rms for each in (found, lagging)]
    return lagging if both[1] < both[0] else found


def _searched(record: SurfaceRecord, parameters: FloatArray, fixed: Rows) -> LinearisedSurface:
    """Return the best fit downhill from a point (Gauss-Newton), with smaller steps if needed."""
    rms = Point.at(record, parameters).rms
    for _ in range(_ROUNDS):
        step = _around(record, parameters, fixed).parameters - parameters
        for part in _PARTS:
            there = parameters + part * step
            rms_there = Point.at(record, there).rms
            if rms_there < rms:
                break
        else:
            break
        parameters, rms = there, rms_there
        if np.max(np.abs(step[CREEP:])) < _SETTLED:
            break
    last = _around(record, parameters, fixed)
    # A search that has not settled may end with a step too far.
    too_far = Point.at(record, last.parameters).rms > rms
    return replace(last, parameters=parameters) if too_far else last


def _around(record: SurfaceRecord, parameters: FloatArray, fixed: Rows) -> LinearisedSurface:
    """Return the problem around a point, and its solution."""
    point, weights = Point.at(record, parameters), parameters[CREEP:OFFSET]
    total = 1.0 + float(np.sum(weights))
    regressors = np.zeros((record.positions.size, COUNT))
    crept = with_creep(point.quick, weights, record.period_s)
    regressors[:, :CREEP] = point.shown(crept)
    # The start of the lags changes with their weights and with the offset, too.
    lags = point.lags - (point.start / total * point.started)[:, np.newaxis]
    regressors[:, CREEP:OFFSET] = lags if fixed[CREEP] else point.shown(lags)
    regressors[:, OFFSET] = 1.0 - point.shown(point.started) / total
    # A delay of one period more shifts the displacement by its change per sample.
    regressors[:, DELAY] = -np.gradient(point.predicted)
    if not fixed[FREQUENCY]:
        for place, difference in _MODE_STEPS.items():
            regressors[:, place] = point.gradient(place, difference)
    for place, difference in _FORM_STEPS.items():
        if not fixed[place]:
            there = Point.at(record, parameters + difference * np.eye(COUNT)[place])
            regressors[:, place] = (there.predicted - point.predicted) / difference
    target = record.positions - point.predicted + regressors @ parameters
    counted = record.counted
    found = solved(regressors[counted], target[counted], parameters, fixed)
    drives = record.drives_at(float(parameters[DELAY]) * record.period_s)
    return LinearisedSurface(regressors, target, counted, fixed, found, drives, record.period_s)
