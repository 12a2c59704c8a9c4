"""The state of a Bouc-Wen stage along a monotonic move, compiled.

    dg = dv - (β·|dv|·g + γ·dv·|g|)·|g/g_s|^(n-1),   g_s = 1/(β+γ)

With g = h/α and the drive v; `path.py` has the displacement. A monotonic move has a closed form if
the exponent n is 1, and is integrated otherwise.
"""

from math import ceil, exp, log1p
from typing import Final

from piezod.jit import compiled

LONGEST_STEP: Final = 1e-3
"""Of the integration, in nominal drives; its error over the range is below 1e-7."""


@compiled
def risen(g: float, rise: float, beta: float, gamma: float, exponent: float) -> float:
    """Return g after v has risen; a fall is the same for -g.

    Args:
        g: At the start.
        rise: Change of v in nominal drives, not negative.
        beta: β.
        gamma: γ, less than β.
        exponent: n.
    """
    if exponent != 1.0:
        return integrated(g, rise, beta, gamma, exponent)
    if g < 0.0:  # the rate of approach changes where g passes 0
        rate = beta - gamma
        to_zero = log1p(-g * rate) / rate
        if rise <= to_zero:
            return 1.0 / rate + (g - 1.0 / rate) * exp(-rate * rise)
        rise -= to_zero
        g = 0.0
    rate = beta + gamma
    return 1.0 / rate + (g - 1.0 / rate) * exp(-rate * rise)


@compiled
def integrated(g: float, rise: float, beta: float, gamma: float, exponent: float) -> float:
    """Return g after v has risen, as `risen`, for any n: by the method of Runge and Kutta."""
    steps = ceil(rise / LONGEST_STEP)
    for _ in range(steps):
        step = rise / steps
        first = slope(g, beta, gamma, exponent)
        second = slope(g + step * first / 2.0, beta, gamma, exponent)
        third = slope(g + step * second / 2.0, beta, gamma, exponent)
        fourth = slope(g + step * third, beta, gamma, exponent)
        g += step * (first + 2.0 * second + 2.0 * third + fourth) / 6.0
    return g


@compiled
def slope(g: float, beta: float, gamma: float, exponent: float) -> float:
    """Return dg/dv on a rise."""
    relaxed = (beta * g + gamma * abs(g)) * ((beta + gamma) * abs(g)) ** (exponent - 1.0)
    return float(1.0 - relaxed)
