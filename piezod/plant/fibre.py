"""Where a fibre bundle's light has its maximum, from how crooked its curve is.

The light that a bundle of fibres collects from a mirror grows with the gap, nearly in proportion,
up to a maximum; beyond that it falls, in the end with the square of the gap. The curve used here is
V(g) = light · slope · g / (1 + (g/g_peak)³/2), whose maximum 2/3 · light · slope · g_peak is at
g_peak (`kernel.fibre_v`). On the near side its crookedness depends on g_peak alone.
"""

from math import inf, sqrt

import numpy as np

BEST_GAP = 1 / 3
"""Gap at rest of a well-placed probe, as a fraction of the travel."""


def line_residual(peak_gap: float) -> float:
    """Give what the best straight line leaves of the curve over the travel.

    Args:
        peak_gap: g_peak as a multiple of the travel, more than 4/3.

    Returns:
        Greatest error of the displacement told by the line of least squares, as a fraction of the
        travel.
    """
    position = np.linspace(0, 1, 401)
    gap = BEST_GAP + position
    voltage = gap / (1 + (gap / peak_gap) ** 3 / 2)
    line = np.polynomial.Polynomial.fit(voltage, position, 1)
    return float(np.max(np.abs(line(voltage) - position)))


def peak_gap_um(nonlinearity: float, travel_um: float) -> float:
    """Find the gap of greatest light at which `line_residual` is `nonlinearity`.

    Args:
        nonlinearity: From 0 (a straight line: the maximum is infinitely far) to 0.05.
        travel_um: Travel of the stage in µm.
    """
    if nonlinearity <= 0:
        return inf
    low, high = 1.5, 1e3
    while high / low > 1 + 1e-12:
        middle = sqrt(low * high)
        if line_residual(middle) > nonlinearity:
            low = middle
        else:
            high = middle
    return low * travel_um
