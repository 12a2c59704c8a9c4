"""Bouc-Wen hysteresis, compiled, in closed form for each monotonic move of the drive.

    y = (u - h) / n,   dh = α·dv - β·|dv|·h - γ·dv·|h|

y is the hysteretic part of the displacement and n its value at the nominal drive. v follows the
drive u at the distance r, the pinning: it stands still while u oscillates by less. The state is
v and g = h/α.
"""

from math import exp, log1p
from typing import Any, Final, TypeAlias

from piezod.jit import compiled
from piezod.plant.laws import BoucWen

Record: TypeAlias = Any  # a (1,) array of `layout.CONSTANTS` or `layout.STATE`

BOUC_WEN: Final = 2


@compiled
def risen(g: float, rise: float, beta: float, gamma: float) -> float:
    """Return g after v has risen; a fall is the same for -g.

    Args:
        g: At the start.
        rise: Change of v in nominal drives, not negative.
        beta: β.
        gamma: γ, less than β.
    """
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
def bouc_wen(unit: float, state: Record, constants: Record) -> float:
    """Move the drive monotonically to `unit` and return the displacement in travels.

    Args:
        unit: Drive in nominal drives.
        state: State of the plant.
        constants: Constants of the plant.
    """
    s, c = state[0], constants[0]
    if unit - c.pinning > s.v:
        s.g = risen(s.g, unit - c.pinning - s.v, c.beta, c.gamma)
        s.v = unit - c.pinning
    elif unit + c.pinning < s.v:
        s.g = -risen(-s.g, s.v - unit - c.pinning, c.beta, c.gamma)
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
    saturated = 1 / (law.beta + law.gamma)
    way = 2 * law.pinning  # v turns later than the drive, by this distance
    at_rest = -risen(-saturated, highest - way, law.beta, law.gamma)
    at_nominal = risen(at_rest, 1 - way, law.beta, law.gamma)
    return {
        "alpha": law.alpha,
        "beta": law.beta,
        "gamma": law.gamma,
        "pinning": law.pinning,
        "g_at_rest": at_rest,
        "part_at_nominal": 1 - law.alpha * (at_nominal - at_rest),
    }
