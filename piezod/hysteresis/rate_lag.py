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

from math import asinh, cosh, sinh, sqrt

import numpy as np

from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled

ACTIVATION, PROMPT, ADVANCE = 0, 1, 2
"""Indices of a lag, shape (3,): w, the prompt slope, and ρ. Without rate dependence w is 0."""
REFERENCE_RATE_PER_S = 0.01
"""r: below this share of the range per second there is hardly any lag. It is fixed, because a
record determines only its logarithm, and that badly."""
_MAX_STEPS = 20
"""Largest number of steps of the search for z; four to seven are needed."""
_SAME = 1e-15  # a smaller step, as a share of the value, is rounding


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

    With s = asinh((z - z_before) / ρ) it solves ρ sinh s + w s = |v - z_before|. The left side is
    convex, so that Newton's method descends to s from any start above it.
    """
    if lag[ACTIVATION] == 0.0:
        return drive
    move = abs(drive - before)
    s = min(move / lag[ACTIVATION], asinh(move / lag[ADVANCE]))  # what s is with one of both terms
    for _ in range(_MAX_STEPS):
        miss = lag[ADVANCE] * sinh(s) + lag[ACTIVATION] * s - move
        step = miss / (lag[ADVANCE] * cosh(s) + lag[ACTIVATION])
        s -= step
        if abs(step) <= _SAME * s:
            break
    moved = min(lag[ADVANCE] * sinh(s), move)
    return before + moved if drive > before else before - moved
