"""The Preisach model of the stage: Everett function and memory, compiled.

A Preisach model is given by its Everett function E: the change of displacement while the drive u
(in nominal drives) rises from a minimum β to α. On the way back from α to β the displacement falls
by the same amount. The state is the list of turning points that no later turning point has deleted;
it needs no grid, so return points and minor loops are exact for any E.

**Power law.** The Everett function of the variants `stack`, `flexure` and `afm` is

    E(α, β) = (r·D + i·D^p) · (1 + κ·(S - 1/2)),   D = α - β,   S = (α + β)/2

It is the exact integral of the density μ(α, β) = -∂²E/∂α∂β = i·p·(p - 1)·D^(p - 2) ·
(1 + κ·(S - 1/2)) plus a reversible part on the diagonal. The density is nowhere negative if
|κ·(S - 1/2)| ≤ 1. The relative width of a loop grows with its swing as on a measured stage, and
κ makes the two branches differ. `tests/plant/test_hysteresis.py` holds the comparison in numbers.

**Table.** Of any other density E is r·D + i·F(α, β), with F from the table of `density.py`.
"""

from typing import Any, Final, TypeAlias

from piezod.jit import compiled
from piezod.plant.density import FIRST, SPACING

Record: TypeAlias = Any  # a (1,) array of `layout.CONSTANTS` or `layout.STATE`

POWER_LAW: Final = 0
TABLE: Final = 1


@compiled
def cubic(t: float, before: float, left: float, right: float, after: float) -> float:
    """Interpolate between `left` (t = 0) and `right` (t = 1) with continuous slope."""
    bend = 2.0 * before - 5.0 * left + 4.0 * right - after
    twist = 3.0 * (left - right) + after - before
    return left + 0.5 * t * (right - before + t * (bend + t * twist))


@compiled
def tabulated(upper: float, lower: float, constants: Record) -> float:
    """Return the Everett function of the hysteretic part from its table.

    Args:
        upper: α, in nominal drives.
        lower: β, in nominal drives.
        constants: Constants of the plant.
    """
    table = constants[0].everett_table
    row, column = (upper - FIRST) / SPACING, (lower - FIRST) / SPACING
    i, j = int(row), int(column)
    # The highest drive is on the last but one node, which has no cell of its own.
    i, j = min(i, len(table) - 3), min(j, len(table) - 3)
    t, u = row - i, column - j
    return cubic(
        t,
        cubic(u, table[i - 1, j - 1], table[i - 1, j], table[i - 1, j + 1], table[i - 1, j + 2]),
        cubic(u, table[i, j - 1], table[i, j], table[i, j + 1], table[i, j + 2]),
        cubic(u, table[i + 1, j - 1], table[i + 1, j], table[i + 1, j + 1], table[i + 1, j + 2]),
        cubic(u, table[i + 2, j - 1], table[i + 2, j], table[i + 2, j + 1], table[i + 2, j + 2]),
    )


@compiled
def everett(upper: float, lower: float, constants: Record) -> float:
    """Return the change of displacement between two drives, in travels: E of the module docstring.

    Args:
        upper: α, in nominal drives, at least `lower`.
        lower: β, in nominal drives.
        constants: Constants of the plant.
    """
    c = constants[0]
    swing = upper - lower
    value = c.reversible * swing
    if c.law == TABLE:
        return float(value + c.irreversible * tabulated(upper, lower, constants))
    if c.irreversible > 0.0:
        value += c.irreversible * swing**c.exponent
    return float(value * (1.0 + c.skew * ((upper + lower) / 2.0 - 0.5)))


@compiled
def preisach(unit: float, state: Record, constants: Record) -> float:
    """Move the drive monotonically to `unit` and return the displacement in travels.

    In the list of turning points, minima have even indices and maxima odd ones. The first two are
    the ends of the range: the drive never passes them, and they are never deleted.

    Args:
        unit: Drive in nominal drives, from `lowest` to `highest`.
        state: State of the plant.
        constants: Constants of the plant.
    """
    s = state[0]
    at, value = s.turn_at, s.turn_value
    depth = s.depth
    rising = depth % 2 == 1
    if (rising and unit < s.unit) or (not rising and unit > s.unit):
        if depth == len(at):  # a full list loses its innermost pair
            depth -= 2
            s.dropped += 1
        at[depth] = s.unit
        value[depth] = s.hysteretic
        depth += 1
        rising = not rising
    if rising:
        # Passing an earlier maximum closes the loop inside it; its two turning points are deleted.
        while depth > 3 and unit >= at[depth - 2]:
            depth -= 2
        s.hysteretic = value[depth - 1] + everett(unit, at[depth - 1], constants)
    else:
        while depth > 3 and unit <= at[depth - 2]:
            depth -= 2
        s.hysteretic = value[depth - 1] - everett(at[depth - 1], unit, constants)
    s.depth = depth
    s.unit = unit
    return float(s.hysteretic)
