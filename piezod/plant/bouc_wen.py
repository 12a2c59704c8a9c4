"""Bouc-Wen hysteresis, compiled.

    y = (u - h) / N,   dh = α·dv - (β·|dv|·h + γ·dv·|h|)·|h/h_s|^(n-1),   h_s = α/(β+γ)

y is the hysteretic part of the displacement and N its value at the nominal drive. v follows the
drive u at the distance r, the pinning: it stands still while u oscillates by less. The state is
v and g = h/α. A monotonic move has a closed form if the exponent n is 1, and is integrated
otherwise.
"""

from math import ceil, exp, log1p
from typing import Any, Final, TypeAlias

from piezod.jit import compiled
from piezod.plant.laws import BoucWen

Record: TypeAlias = Any  # a (1,) array of `layout.CONSTANTS` or `layout.STATE`

BOUC_WEN: Final = 2
LONGEST_STEP: Final = 1e-3
"""Of the integration, in nominal drives; its error over the range is below 1e-9."""


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


@compiled
def bouc_wen(unit: float, state: Record, constants: Record) -> float:
    """Move the drive monotonically to `unit` and return the displacement in travels.

    Args:
        unit: Drive in nominal drives.
        state: State of the plant.
        constants: Constants of the plant.
    """
    s, c = state[0], constants[0]
    if unit - c.pinning > s.v:
        s.g = risen(s.g, unit - c.pinning - s.v, c.beta, c.gamma, c.bouc_wen_exponent)
        s.v = unit - c.pinning
    elif unit + c.pinning < s.v:
        s.g = -risen(-s.g, s.v - unit - c.pinning, c.beta, c.gamma, c.bouc_wen_exponent)
        s.v = unit + c.pinning
    part = (unit - c.alpha * (s.g - c.g_at_rest)) / c.part_at_nominal
    s.hysteretic = c.reversible * unit + c.irreversible * part
    s.unit = unit
    return float(s.hysteretic)


def bouc_wen_constants(law: BoucWen, highest: float) -> dict[str, float]:
    """Return the constants of a stage that rests at 0 after its highest drive.

    Args:
        law: Parameters.
        highest: Highest drive, in nominal drives.
    """
    of_g = (law.beta, law.gamma, law.exponent)
    saturated = 1 / (law.beta + law.gamma)
    way = 2 * law.pinning  # v turns later than the drive, by this distance
    at_rest = -risen(-saturated, highest - way, *of_g)
    at_nominal = risen(at_rest, 1 - way, *of_g)
    return {
        "alpha": law.alpha,
        "beta": law.beta,
        "gamma": law.gamma,
        "bouc_wen_exponent": law.exponent,
        "pinning": law.pinning,
        "g_at_rest": at_rest,
        "part_at_nominal": 1 - law.alpha * (at_nominal - at_rest),
    }
