"""Fits a surface, creep and the delay to a record, all at once: the forward form of identification.

The displacement follows from the drive, which is known without noise:

    x(t) = M[y + Σ w_k L_k[y]] + offset,   y = H[z] + p (v - z) + w h[z],   v = v(t - delay).

z is the drive that lags behind v with the rate, see `rate_lag`; p is the prompt slope; h relaxes
along the path of the drive, see `path_relaxation`; M is the first mode, see `first_mode`. These
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
from piezod.experiment.fit.problem import STEP_PARTS, LinearProblem, first_better
from piezod.experiment.fit.record import Rows
from piezod.experiment.fit.surface.creep_regressors import with_creep
from piezod.experiment.fit.surface.first_mode import ModeGuess
from piezod.experiment.fit.surface.parameters import (
    ACTIVATION,
    COUNT,
    CREEP,
    DAMPING,
    DECAY,
    DELAY,
    EXPONENT,
    FREQUENCY,
    MODE,
    MODE_LAG,
    OFFSET,
    PATH,
    PROMPT,
    SKEW,
    START_MODE_LAG,
    Term,
    form_of,
    penalised_gram,
    solved,
)
from piezod.experiment.fit.surface.point import Point, SurfaceRecord
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.least_squares import parameter_covariance
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.surface_form import branch_slopes

START_ACTIVATION = 0.003
"""Activation at which its search begins, as a share of the drive's range."""
START_DECAY = 4.0
"""Decay of the path at which its search begins, in 1/range."""
START_EXPONENT = 1.5
"""Exponent of the path at which its search begins."""
_ROUNDS = 13
_SETTLED = 1e-8
"""The search ends where a step makes the rms error smaller by less than this share of it: with
20 000 samples, one standard error of a parameter makes it larger by 2.5e-5."""
_FORM_STEPS = {ACTIVATION: 2e-4, DECAY: 1e-3, SKEW: 1e-3, EXPONENT: 1e-3}
_MODE_STEPS = {DELAY: 1e-3, FREQUENCY: 1e-6, DAMPING: 1e-5, MODE_LAG: 1e-3}
"""Steps of differences."""


@dataclass(frozen=True)
class LinearisedSurface(LinearProblem):
    """The problem of a surface around its solution; the predicted value is the displacement.

    It has 43 parameters; the delay is in sample periods.
    """

    fixed: Rows  #: (43,) mask of the parameters that are not searched.
    drives: FloatArray  #: (n,) drives of the record, delayed.
    period_s: float  #: Sample period, in s.

    @property
    def drive_changes(self) -> FloatArray:
        """Change of the drive per change of the displacement."""
        form = form_of(self.parameters, self.period_s)
        return 1.0 / branch_slopes(self.parameters[:SIZE], self.drives, form)

    @property
    def creep_gradient(self) -> FloatArray | None:
        """Change of the creep per decade with each parameter."""
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
        """Return the covariance of the parameters without active constraints."""
        free = ~self.fixed
        covariance = np.zeros((free.size, free.size))
        gram = penalised_gram(self.regressors[self.counted], free)
        covariance[np.ix_(free, free)] = parameter_covariance(gram, residual_variance)
        return covariance

    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit these rows best."""
        return solved(self.regressors[rows], self.target[rows], self.parameters, self.fixed)


def fit_surface(
    record: SurfaceRecord,
    *,
    creep: bool,
    delay_s: float | None,
    start_delay_s: float,
    terms: frozenset[Term] = frozenset(),
    mode: ModeGuess | None = None,
) -> LinearisedSurface:
    """Fit the coefficients and the offset, and the creep and the delay if requested.

    Args:
        record: The record.
        creep: Whether the lags of the creep are fitted.
        delay_s: Delay of the displacement behind the drive, in s; None if it is fitted.
        start_delay_s: Delay at which the search begins, in s.
        terms: Optional terms that are fitted.
        mode: First mode at which its search begins; None if none is fitted.

    Raises:
        ModelError: If the record does not determine the coefficients.
    """
    rate, path, exponent = (each in terms for each in (Term.RATE, Term.PATH, Term.EXPONENT))
    fixed = np.zeros(COUNT, dtype=np.bool_)
    fixed[CREEP:OFFSET] = not creep
    fixed[DELAY] = delay_s is not None
    fixed[[PROMPT, ACTIVATION]] = not rate
    fixed[[PATH, DECAY, SKEW]] = not path
    fixed[EXPONENT] = not exponent
    fixed[[*MODE]] = mode is None
    parameters = np.zeros(COUNT)
    parameters[ACTIVATION] = START_ACTIVATION if rate else 0.0
    parameters[DECAY] = START_DECAY if path else 0.0
    parameters[EXPONENT] = START_EXPONENT if exponent else 1.0
    parameters[0] = 1.0  # displacement in proportion to the drive
    parameters[DELAY] = (start_delay_s if delay_s is None else delay_s) / record.period_s
    if mode is not None:
        parameters[[*MODE]] = mode.frequency, mode.damping, 0.0
    # First what is linear alone: any fit is a better start than a line.
    not_yet = np.ones_like(fixed)
    not_yet[:SIZE] = not_yet[OFFSET] = False
    not_yet[PROMPT], not_yet[PATH] = not rate, not path
    parameters = _around(Point.at(record, parameters), not_yet).parameters
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
    return lagging if lagging.rms < found.rms else found


def _searched(record: SurfaceRecord, parameters: FloatArray, fixed: Rows) -> LinearisedSurface:
    """Return the best fit downhill from a point (Gauss-Newton), with smaller steps if needed."""
    point = Point.at(record, parameters)
    around = _around(point, fixed)
    for _ in range(_ROUNDS):
        ways = ((1.0 - part) * point.parameters + part * around.parameters for part in STEP_PARTS)
        better = first_better(point, (Point.at(record, each) for each in ways))
        if better is None or better.rms > (1.0 - _SETTLED) * point.rms:
            break
        point, around = better, _around(better, fixed)
    return replace(around, parameters=point.parameters)


def _around(point: Point, fixed: Rows) -> LinearisedSurface:
    """Return the problem around a point, and its solution."""
    record, parameters = point.record, point.parameters
    weights = parameters[CREEP:OFFSET]
    total = 1.0 + float(np.sum(weights))
    regressors = np.zeros((record.positions.size, COUNT))
    steps = {place: step for place, step in _FORM_STEPS.items() if not fixed[place]}
    changes = [point.quick_gradient(place, step) for place, step in steps.items()]
    crept = with_creep(np.column_stack([point.quick, *changes]), weights, record.period_s)
    regressors[:, :CREEP], regressors[:, [*steps]] = np.split(point.shown(crept), [CREEP], axis=1)
    # The start of the lags changes with their weights and with the offset, too.
    lags = point.lags - (point.start / total * point.started)[:, np.newaxis]
    regressors[:, CREEP:OFFSET] = lags if fixed[CREEP] else point.shown(lags)
    regressors[:, OFFSET] = 1.0 - point.shown(point.started) / total
    # A delay of one period more shifts the displacement by its change per sample.
    regressors[:, DELAY] = -np.gradient(point.predicted)
    if not fixed[FREQUENCY]:
        for place, difference in _MODE_STEPS.items():
            regressors[:, place] = point.gradient(place, difference)
    target = record.positions - point.predicted + regressors @ parameters
    counted = record.counted
    found = solved(regressors[counted], target[counted], parameters, fixed)
    drives = record.drives_at(float(parameters[DELAY]) * record.period_s)
    return LinearisedSurface(regressors, target, counted, found, fixed, drives, record.period_s)
