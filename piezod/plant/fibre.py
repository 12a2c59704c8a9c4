"""The gap at which a fibre bundle receives most light, computed from the nonlinearity of its curve.

The light that a fibre bundle collects from a mirror grows with the gap, at first nearly in
proportion, up to a maximum. Beyond it the light falls, finally with the square of the gap. The
curve of this simulation is V(g) = light · slope · g / (1 + (g/g_peak)³/2); its maximum 2/3 · light
· slope · g_peak is at g_peak (`kernel.fibre_v`). On the near side its nonlinearity depends on
g_peak alone.
"""

from functools import lru_cache
from math import inf, sqrt

import numpy as np

BEST_GAP = 1 / 3
"""Gap at rest of a correctly placed probe, as a fraction of the travel."""


def line_residual(peak_gap: float) -> float:
    """Return the worst deviation of the curve from its best straight line over the travel.

    Args:
        peak_gap: g_peak as a multiple of the travel, more than 4/3.

    Returns:
        Largest error of a displacement computed with the least-squares line, as a fraction of the
        travel.
    """
    position = np.linspace(0, 1, 401)
    gap = BEST_GAP + position
    voltage = gap / (1 + (gap / peak_gap) ** 3 / 2)
    line = np.polynomial.Polynomial.fit(voltage, position, 1)
    return float(np.max(np.abs(line(voltage) - position)))


@lru_cache(maxsize=64)  # the bisection takes as long as the rest of a simulated axis
def peak_gap_um(nonlinearity: float, travel_um: float) -> float:
    """Return the gap of maximum light for which `line_residual` equals `nonlinearity`, in µm.

    Args:
        nonlinearity: From 0 (a straight line: the maximum is infinitely far) to 0.05.
        travel_um: Travel of the stage in µm.
    """
    if nonlinearity <= 0:
        return inf
    low, high = 1.5, 1e3
    # Bisection on a logarithmic scale; the residual falls monotonically with the peak gap.
    while high / low > 1 + 1e-12:
        middle = sqrt(low * high)
        if line_residual(middle) > nonlinearity:
            low = middle
        else:
            high = middle
    return low * travel_um
