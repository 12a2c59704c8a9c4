"""The parameters of the fit of a surface: their places, their bounds, and one linear problem."""

from typing import Final

import numpy as np

from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.control.law.first_mode import FirstMode
from piezod.experiment.fit.record import Rows
from piezod.hysteresis import LEAST_SLOPE
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.everett_bounds import slope_rows
from piezod.hysteresis.least_squares import minimise
from piezod.hysteresis.memory import FloatArray

PROMPT, CREEP = SIZE, SIZE + 1
OFFSET = CREEP + TIME_CONSTANTS_S.size
DELAY, ACTIVATION, FREQUENCY, DAMPING, MODE_LAG, COUNT = (OFFSET + i for i in range(1, 7))
"""Places of the prompt slope, the first lag, the offset, the delay in sample periods, the
activation, and the frequency (in cycles per sample), the damping ratio and the lag (in sample
periods) of the first mode, behind the 24 coefficients; and the number of all parameters."""
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
    FREQUENCY: FREQUENCIES,
    DAMPING: (LOWEST_DAMPING, HIGHEST_DAMPING),
    MODE_LAG: (0.0, HIGHEST_MODE_LAG),
    **dict.fromkeys(range(CREEP, OFFSET), (0.0, MAX_LAG)),
}
"""Lowest and highest value of a parameter; None for any."""


def mode_of(parameters: FloatArray, period_s: float) -> FirstMode | None:
    """Return the first mode of parameters, shape (39,); None if they have none."""
    if not parameters[FREQUENCY]:
        return None
    frequency, damping, lag = parameters[[*MODE]].tolist()
    return FirstMode(frequency / period_s, damping, lag * period_s)


def solved(
    regressors: FloatArray, target: FloatArray, known: FloatArray, fixed: Rows
) -> FloatArray:
    """Solve one linear problem for the parameters that are not fixed; the others stay.

    Args:
        regressors: (n, 39) regressors of all parameters.
        target: (n,) values that they must add up to.
        known: (39,) parameters; those that are fixed keep these values.
        fixed: (39,) mask of the parameters that are not searched.

    Returns:
        The parameters, shape (39,).
    """
    free = ~fixed
    rows, rest = regressors[:, free], target - regressors[:, fixed] @ known[fixed]
    constraints, bounds = _constraints()
    needed = constraints[:, free].any(axis=1)
    gram = penalised(rows, free)
    found = known.copy()
    found[free] = minimise(gram, rows.T @ rest, constraints[needed][:, free], bounds[needed])
    # The solver keeps the bounds up to rounding; this keeps them exactly.
    for place, (low, high) in _SCALAR_BOUNDS.items():
        if free[place]:
            found[place] = np.clip(found[place], low, high)
    return found


def penalised(rows: FloatArray, free: Rows) -> FloatArray:
    """Return the Gram matrix of the free parameters, with penalties.

    Args:
        rows: (n, f) regressors of the free parameters.
        free: (39,) mask of these parameters.
    """
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


def _constraints() -> tuple[FloatArray, FloatArray]:
    """Return A and b for which A p ≥ b, shapes (k, 39) and (k,)."""
    slopes, units = np.pad(slope_rows(), ((0, 0), (0, COUNT - SIZE))), np.eye(COUNT)
    rows, bounds = [*slopes], [LEAST_SLOPE] * len(slopes)
    for place, (low, high) in _SCALAR_BOUNDS.items():
        rows.append(units[place])
        bounds.append(low)
        if high is not None:
            rows.append(-units[place])
            bounds.append(-high)
    return np.array(rows), np.array(bounds)
