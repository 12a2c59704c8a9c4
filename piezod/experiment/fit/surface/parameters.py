"""The parameters of the fit of a surface: their places, their bounds, and one linear problem."""

from enum import Enum
from typing import Final

import numpy as np

from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.control.law.first_mode import FirstMode
from piezod.experiment.fit.record import Rows
from piezod.hysteresis import LEAST_SLOPE, SurfaceForm
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.everett_bounds import slope_rows
from piezod.hysteresis.least_squares import minimise
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import PathRelaxation, steepest_relaxation

PROMPT, PATH, CREEP = SIZE, SIZE + 1, SIZE + 2
OFFSET = CREEP + TIME_CONSTANTS_S.size
DELAY, ACTIVATION, DECAY, SKEW, EXPONENT, FREQUENCY, DAMPING, MODE_LAG, COUNT = (
    OFFSET + i for i in range(1, 10)
)
"""Places of the prompt slope, the weight of the path, the first lag, the offset, the delay in
sample periods, the activation, decay, skew and exponent of the path, and the frequency (in cycles
per sample), the damping ratio and the lag (in sample periods) of the first mode, behind the 24
coefficients; and the number of all parameters."""
MODE: Final = (FREQUENCY, DAMPING, MODE_LAG)
RIDGE = 1e-6
"""Penalty on the coefficients, relative to the mean power of their regressors."""
CREEP_RIDGE = 1e-2
"""Penalty on differences between the weights of lags: without information they are all equal, which
is creep that grows with the logarithm of time."""
MAX_LAG = 0.1
"""Largest weight of a lag, as a share of the displacement; all lags together stay below 1."""
MAX_ACTIVATION = 0.05
"""Largest activation, as a share of the drive's range."""
DECAYS, LARGEST_SKEW = (0.3, 30.0), 0.9
"""Lowest and highest decay, in 1/range: what relaxes more slowly is part of the surface, and what
relaxes faster looks like a jump at each reversal; and the largest skew of either sign."""
HIGHEST_EXPONENT = 4.0
"""Highest exponent of the path; with 1 a small state relaxes as a large one does."""
FREQUENCIES = (0.002, 0.4)
"""Lowest and highest frequency of a mode, in cycles per sample: half a cycle per sample is the
limit of sampling, and the motion of slower modes looks like that of the drive."""
LOWEST_DAMPING, HIGHEST_DAMPING = 0.001, 0.3
"""Bounds of the damping ratio of a mode. With more it hardly rings, and is rather a filter of the
sensor."""
START_MODE_LAG, HIGHEST_MODE_LAG = 0.5, 5.0
"""Lag beside the mode at which its search begins, and its highest value, in sample periods. Near
zero a lag is like a delay, which is fitted anyway."""
_SCALAR_BOUNDS: Final = {
    PROMPT: (0.0, None),
    ACTIVATION: (0.0, MAX_ACTIVATION),
    DECAY: DECAYS,
    SKEW: (-LARGEST_SKEW, LARGEST_SKEW),
    EXPONENT: (1.0, HIGHEST_EXPONENT),
    FREQUENCY: FREQUENCIES,
    DAMPING: (LOWEST_DAMPING, HIGHEST_DAMPING),
    MODE_LAG: (0.0, HIGHEST_MODE_LAG),
    **dict.fromkeys(range(CREEP, OFFSET), (0.0, MAX_LAG)),
}
"""Lowest and highest value of a parameter; None for any."""


class Term(Enum):
    """An optional term of a surface."""

    RATE = "lag with the rate"
    PATH = "relaxation along the path"
    EXPONENT = "its exponent"


def form_of(parameters: FloatArray, period_s: float) -> SurfaceForm:
    """Return the form of parameters, shape (43,)."""
    weight, decay, skew, exponent = parameters[[PATH, DECAY, SKEW, EXPONENT]].tolist()
    path = PathRelaxation(weight, decay, skew, exponent) if decay else None
    return SurfaceForm(float(parameters[ACTIVATION]), float(parameters[PROMPT]), period_s, path)


def mode_of(parameters: FloatArray, period_s: float) -> FirstMode | None:
    """Return the first mode of parameters, shape (43,); None if they have none."""
    if not parameters[FREQUENCY]:
        return None
    frequency, damping, lag = parameters[[*MODE]].tolist()
    return FirstMode(frequency / period_s, damping, lag * period_s)


def solved(
    regressors: FloatArray, target: FloatArray, known: FloatArray, fixed: Rows
) -> FloatArray:
    """Solve one linear problem for the parameters that are not fixed; the others stay.

    Args:
        regressors: (n, 43) regressors of all parameters.
        target: (n,) values that they must add up to.
        known: (43,) parameters; those that are fixed keep these values.
        fixed: (43,) mask of the parameters that are not searched.

    Returns:
        The parameters, shape (43,).
    """
    free = ~fixed
    rest = target - regressors[:, fixed] @ known[fixed]
    constraints, bounds = _constraints(free, float(known[SKEW]))
    gram, right_side = penalised_gram(regressors, free), (regressors.T @ rest)[free]
    found = known.copy()
    found[free] = minimise(gram, right_side, constraints[:, free], bounds)
    # The solver keeps the bounds up to rounding; this keeps them exactly.
    for place, (low, high) in _SCALAR_BOUNDS.items():
        if free[place]:
            found[place] = np.clip(found[place], low, high)
    return found


def penalised_gram(regressors: FloatArray, free: Rows) -> FloatArray:
    """Return the Gram matrix of the free parameters, with penalties, shape (f, f).

    Args:
        regressors: (n, 43) regressors of all parameters.
        free: (43,) mask of these parameters.
    """
    gram = regressors.T @ regressors
    power = np.where(free, np.diag(gram), 0.0)
    # A parameter without effect keeps its value: the prompt slope, if nothing lags.
    penalties = np.diag(1e-9 * np.maximum(power, 1e-6 * power.max()))
    penalties[:SIZE, :SIZE] += RIDGE * float(np.mean(power[:SIZE])) * np.eye(SIZE)
    if free[CREEP]:
        count = OFFSET - CREEP
        differences = np.eye(count) - 1.0 / count
        mean = float(np.mean(power[CREEP:OFFSET]))
        penalties[CREEP:OFFSET, CREEP:OFFSET] += CREEP_RIDGE * mean * differences
    return (gram + penalties)[np.ix_(free, free)]


def _constraints(free: Rows, skew: float) -> tuple[FloatArray, FloatArray]:
    """Return A and b for which A p ≥ b, shapes (k, 43) and (k,).

    Args:
        free: (43,) mask of the parameters that are searched.
        skew: Skew of the path.
    """
    slopes, units = np.pad(slope_rows(), ((0, 0), (0, COUNT - SIZE))), np.eye(COUNT)
    blocks = [slopes]
    if free[PATH]:  # where the path adds its least slope, the sum is large enough, too
        blocks.append(slopes + steepest_relaxation(skew) * units[PATH])
    rows, bounds = [], [LEAST_SLOPE] * sum(map(len, blocks))
    for place, (low, high) in _SCALAR_BOUNDS.items():
        if free[place]:
            rows.append(units[place])
            bounds.append(low)
            if high is not None:
                rows.append(-units[place])
                bounds.append(-high)
    return np.vstack((*blocks, *rows)), np.array(bounds)
