"""Hysteresis that forgets along the path of the drive and has no memory of turns, compiled.

    y = (u - h) / N,   h = α·g

y is the hysteretic part of the displacement and N its value at the nominal drive. v follows the
drive u at the distance r, the pinning: it stands still while u oscillates by less. The state is
v and g; how g follows v depends on the class (`bouc_wen.py`, `dahl.py`).
"""

from collections.abc import Callable
from typing import Any, Final, TypeAlias

from piezod.jit import compiled
from piezod.plant.bouc_wen import risen
from piezod.plant.dahl import approached
from piezod.plant.laws import BoucWen, Dahl

Record: TypeAlias = Any  # a (1,) array of `layout.CONSTANTS` or `layout.STATE`

BOUC_WEN: Final = 2
DAHL: Final = 4


@compiled
def path_part(unit: float, state: Record, constants: Record) -> float:
    """Move the drive monotonically to `unit` and return the displacement in travels.

    Args:
        unit: Drive in nominal drives.
        state: State of the plant.
        constants: Constants of the plant.
    """
    s, c = state[0], constants[0]
    if unit - c.pinning > s.v:
        s.g = _risen(s.g, unit - c.pinning - s.v, constants)
        s.v = unit - c.pinning
    elif unit + c.pinning < s.v:
        s.g = -_risen(-s.g, s.v - unit - c.pinning, constants)
        s.v = unit + c.pinning
    part = (unit - c.alpha * (s.g - c.g_at_rest)) / c.part_at_nominal
    s.hysteretic = c.reversible * unit + c.irreversible * part
    s.unit = unit
    return float(s.hysteretic)


@compiled
def _risen(g: float, rise: float, constants: Record) -> float:
    c = constants[0]
    if c.law == DAHL:
        return float(approached(g, rise, c.saturated))
    return float(risen(g, rise, c.beta, c.gamma, c.bouc_wen_exponent))


def bouc_wen_constants(law: BoucWen, highest: float) -> dict[str, float]:
    """Return the constants of a stage that rests at 0 after its highest drive.

    Args:
        law: Parameters.
        highest: Highest drive, in nominal drives.
    """

    def after(g: float, rise: float) -> float:
        return risen(g, rise, law.beta, law.gamma, law.exponent)

    of_law = {"beta": law.beta, "gamma": law.gamma, "bouc_wen_exponent": law.exponent}
    return {"law": BOUC_WEN, **of_law, **_constants(law, after, highest)}


def dahl_constants(law: Dahl, highest: float) -> dict[str, float]:
    """Return the constants of a stage that rests at 0 after its highest drive, as above."""

    def after(g: float, rise: float) -> float:
        return approached(g, rise, law.saturated)

    return {"law": DAHL, "saturated": law.saturated, **_constants(law, after, highest)}


def _constants(
    law: BoucWen | Dahl, after: Callable[[float, float], float], highest: float
) -> dict[str, float]:
    way = 2 * law.pinning  # v turns later than the drive, by this distance
    at_rest = -after(-law.saturated, highest - way)
    at_nominal = after(at_rest, 1 - way)
    return {
        "alpha": law.alpha,
        "pinning": law.pinning,
        "g_at_rest": at_rest,
        "part_at_nominal": 1 - law.alpha * (at_nominal - at_rest),
    }
