"""The lag of a hysteresis behind its drive, which grows with the logarithm of the rate.

The domains of a ceramic switch with the help of thermal motion: at the rate exp((u - α)/w) a drive
u beyond a threshold α. The faster the drive, the later they switch, by w for each e-fold of the
rate, and the wider is the loop. All thresholds shift alike, so that the hysteresis sees a lagging
drive z instead of v:

    dz/dt = 2 r sinh((v - z) / w).

At a rate far above r the lag is w ln(rate / r), and during a hold it decays with the logarithm of
time. One step of the implicit Euler rule is z + w asinh((z - z_before) / ρ) = v, with ρ = 2 r T.
Without a hysteresis to invert it is solved for v directly. A part of the displacement, the prompt
slope times (v - z), does not lag.

Source: Smith, Seelecke, Dapino, Ounaies, J. Mech. Phys. Solids 54 (2006), for thermally activated
switching; the reduction to one lagging drive is ours.
"""

from math import asinh, sqrt

import numpy as np

from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled

ACTIVATION, PROMPT, ADVANCE = 0, 1, 2
"""Indices of a lag, shape (3,): w, the prompt slope, and ρ. Without rate dependence w is 0."""
REFERENCE_RATE_PER_S = 0.01
"""r: below this share of the range per second there is hardly any lag. It is fixed, because a
record determines only its logarithm, and that badly."""
_MAX_STEPS = 60
_SAME = 1e-15


def new_lag(activation: float, prompt: float, period_s: float) -> FloatArray:
    """Return a lag for samples of this period, shape (3,)."""
    return np.array([activation, prompt, 2.0 * REFERENCE_RATE_PER_S * period_s])


@compiled
def lag_of(lag: FloatArray, before: float, lagging: float) -> float:
    """Return v - z for a lagging drive z after the one before. Real-time safe."""
    if lag[ACTIVATION] == 0.0:
        return 0.0
    return lag[ACTIVATION] * asinh((lagging - before) / lag[ADVANCE])


@compiled
def lag_slope(lag: FloatArray, before: float, lagging: float) -> float:
    """Return the derivative of `lag_of` to the lagging drive. Real-time safe."""
    if lag[ACTIVATION] == 0.0:
        return 0.0
    moved = lagging - before
    return lag[ACTIVATION] / sqrt(moved * moved + lag[ADVANCE] * lag[ADVANCE])


@compiled
def lagging_drive(lag: FloatArray, before: float, drive: float) -> float:
    """Return z for a drive v. Real-time safe.

    Newton's method, with bisection where a step would leave the bracket.
    """
    if lag[ACTIVATION] == 0.0:
        return drive
    low, high = min(before, drive), max(before, drive)
    lagging = 0.5 * (low + high)
    for _ in range(_MAX_STEPS):
        miss = lagging + lag_of(lag, before, lagging) - drive
        if abs(miss) < _SAME:
            break
        if miss > 0.0:
            high = lagging
        else:
            low = lagging
        step = miss / (1.0 + lag_slope(lag, before, lagging))
        lagging = lagging - step if low < lagging - step < high else 0.5 * (low + high)
    return lagging
