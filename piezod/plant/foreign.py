"""The classes of `foreign_laws.py`, compiled: one state of 21 numbers for all of them.

`raw_part` moves the drive monotonically within a sub-step. Coleman-Hodgdon and Duhem follow the
drive at the distance of the pinning, as in `path.py`. The rate of the drive is a mean over 5 ms,
since a command of the loop is a stair.
"""

from math import exp, log10, tanh
from typing import Any, Final, TypeAlias

import numpy as np

from piezod.jit import compiled
from piezod.plant.foreign_laws import (
    PINNING,
    ColemanHodgdon,
    Duhem,
    ForeignLaw,
    MaxwellSlip,
    RatePlays,
)
from piezod.plant.laws import Array

Record: TypeAlias = Any  # a (1,) array of `layout.CONSTANTS` or `layout.STATE`

COLEMAN_HODGDON: Final = 5
DUHEM: Final = 6
MAXWELL_SLIP: Final = 7
RATE_PLAYS: Final = 8
ELEMENTS: Final = 10
PLAYS: Final = 20
INNER: Final = 2 * ELEMENTS + 1
"""Numbers of the state; the last one is the drive."""
FACTS: Final = 4 + 2 * PLAYS
"""Constants of a class; the others are 0."""
RATE_S: Final = 5e-3
_LONGEST: Final = 1e-3  # step of the integration along the path, in nominal drives
_LEVEL: Final = 0.35  # depth of saturation at the lowest drive, -0.2
_SLOW_STEPS: Final = 2000
_STEP_PER_S: Final = 1e9


@compiled
def foreign_part(unit: float, step_s: float, state: Record, constants: Record) -> float:
    """Move the drive monotonically to `unit` and return the displacement in travels.

    Args:
        unit: Drive in nominal drives.
        step_s: Time of the move, in s; 0 for a jump.
        state: State of the plant; `rate` is that of the drive.
        constants: Constants of the plant.
    """
    s, c = state[0], constants[0]
    raw = raw_part(unit, step_s, s.rate, c.law, s.inner, c.facts)
    part = (raw - c.part_at_rest) / c.part_at_nominal
    s.hysteretic = c.reversible * unit + c.irreversible * part
    s.unit = unit
    return float(s.hysteretic)


@compiled
def advance_rate(end: float, step_s: float, state: Record) -> None:
    """Advance the mean rate of the drive by one sub-step, before the drive moves."""
    s = state[0]
    s.rate *= exp(-step_s / RATE_S)
    add_to_rate(end, step_s, state)


@compiled
def add_to_rate(unit: float, step_s: float, state: Record) -> None:
    """Add a move of the drive to its mean rate."""
    s = state[0]
    s.rate += (1.0 - exp(-step_s / RATE_S)) * (unit - s.unit) / step_s


@compiled
def raw_part(
    unit: float, step_s: float, rate: float, law: int, inner: Array, facts: Array
) -> float:
    """Move the drive and return the displacement in the unit of the class."""
    if law in (COLEMAN_HODGDON, DUHEM):
        before = inner[INNER - 1]
        after = min(max(before, unit - PINNING), unit + PINNING)
        inner[INNER - 1] = after
        if law == COLEMAN_HODGDON:
            return _coleman_hodgdon(before, after, inner, facts)
        return _duhem(unit, after - before, inner, facts)
    moved = unit - inner[INNER - 1]
    inner[INNER - 1] = unit
    if law == MAXWELL_SLIP:
        return _maxwell_slip(unit, moved, step_s, rate, inner, facts)
    return _plays(unit, rate, inner, facts)


@compiled
def _coleman_hodgdon(before: float, after: float, inner: Array, facts: Array) -> float:
    """Integrate y along the path by the method of Runge and Kutta."""
    way = after - before
    steps = int(abs(way) / _LONGEST) + 1
    step, y = way / steps, inner[0]
    if way != 0.0:
        for k in range(steps):
            u = before + k * step
            first = _slope(u, y, step, facts)
            second = _slope(u + step / 2.0, y + step * first / 2.0, step, facts)
            third = _slope(u + step / 2.0, y + step * second / 2.0, step, facts)
            fourth = _slope(u + step, y + step * third, step, facts)
            y += step * (first + 2.0 * second + 2.0 * third + fourth) / 6.0
    inner[0] = y
    return float(y)


@compiled
def _slope(unit: float, y: float, way: float, facts: Array) -> float:
    """Return dy/du."""
    s = unit - 0.5
    f = tanh(facts[1] * s) / facts[1]
    g = (1.0 - tanh(facts[1] * s) ** 2) * (1.0 - facts[2] * exp(-((s / facts[3]) ** 2)))
    towards = facts[0] * (f - y)
    return float(g + towards if way > 0.0 else g - towards)


@compiled
def _duhem(unit: float, way: float, inner: Array, facts: Array) -> float:
    """Return u minus both states; on a monotone move each has a closed form."""
    left = unit
    for i in range(2):
        if way >= 0.0:
            end = 1.0 / facts[i]
            inner[i] = end + (inner[i] - end) * exp(-facts[i] * way)
        else:
            end = -1.0 / facts[2 + i]
            inner[i] = end + (inner[i] - end) * exp(facts[2 + i] * way)
        left -= facts[4 + i] * inner[i]
    return left


@compiled
def _maxwell_slip(
    unit: float, moved: float, step_s: float, rate: float, inner: Array, facts: Array
) -> float:
    """Return u minus the forces; the elements that slip have their direction behind the forces."""
    limit = 1.0 + facts[0] * exp(-abs(rate) / facts[1])
    share = 1.0 - exp(-step_s * facts[2])
    way = (moved > 0.0) - (moved < 0.0)
    left = unit
    for i in range(ELEMENTS):
        force, slips, most = inner[i], inner[ELEMENTS + i], facts[3 + i] * limit
        # Only a motion lets an element slip, and in its own direction.
        if slips * way < 0.0:
            slips = 0.0
        if slips == 0.0:
            force += moved / ELEMENTS
            if force * way >= most:
                slips, force = float(way), way * most
        elif way != 0:
            force += share * (slips * most - force)
        inner[i], inner[ELEMENTS + i] = force, slips
        left -= force
    return left


@compiled
def _plays(unit: float, rate: float, inner: Array, facts: Array) -> float:
    """Return the weighted sum of the plays."""
    growth = 1.0 + facts[0] * log10(1.0 + abs(rate) / facts[1])
    right = left = unit
    if facts[2] > 0.0:
        right = tanh(facts[2] * (unit + 0.2) - _LEVEL)
        left = tanh(facts[3] * (unit + 0.2) - _LEVEL)
    total = 0.0
    for j in range(PLAYS):
        threshold = facts[4 + j] * growth
        inner[j] = max(right - threshold, min(left + threshold, inner[j]))
        total += facts[4 + PLAYS + j] * inner[j]
    return total


def foreign_constants(law: ForeignLaw, highest: float) -> dict[str, Any]:
    """Return the constants of a stage that came slowly from its highest drive to 0 long ago.

    Args:
        law: Parameters.
        highest: Highest drive, in nominal drives.
    """
    number, known = _facts(law)
    facts = np.zeros(FACTS)
    facts[: len(known)] = known
    inner = np.zeros(INNER)

    def slowly(start: float, end: float) -> float:
        # Sticking and plays need steps; a second for each lets forces settle.
        ends = np.linspace(start, end, _SLOW_STEPS)
        return [raw_part(unit, 1.0, 0.0, number, inner, facts) for unit in ends.tolist()][-1]

    slowly(0.0, highest)
    at_rest, inner_at_rest = slowly(highest, 0.0), inner.copy()
    if number == MAXWELL_SLIP:  # the travel is that of a step, with springs at their sliding limit
        at_nominal = raw_part(1.0, 0.0, _STEP_PER_S, number, inner, facts)
    else:
        at_nominal = slowly(0.0, 1.0)
    return {
        "law": number,
        "facts": facts,
        "inner_at_rest": inner_at_rest,
        "part_at_rest": at_rest,
        "part_at_nominal": at_nominal - at_rest,
    }


def _facts(law: ForeignLaw) -> tuple[int, list[float]]:
    """Return the number of a class and its constants, in the order of its kernel."""
    match law:
        case ColemanHodgdon():
            return COLEMAN_HODGDON, [law.attraction, law.bend, law.cut, law.spread]
        case Duhem():
            rates = [law.rising_slow, law.rising_quick, law.falling_slow, law.falling_quick]
            return DUHEM, [*rates, law.slow_share, law.quick_share]
        case MaxwellSlip():
            limits = (
                law.slip_length
                * (np.arange(1, ELEMENTS + 1) / ELEMENTS) ** law.slip_grading
                / ELEMENTS
            )
            return MAXWELL_SLIP, [law.static_excess, law.stribeck_per_s, law.slip_hz, *limits]
        case RatePlays():
            thresholds = law.widest * (np.arange(PLAYS) + 0.5) / PLAYS
            steeper = law.saturation * (1 + law.steeper)
            envelope = [law.growth, law.reference_per_s, law.saturation, steeper]
            return RATE_PLAYS, [*envelope, *thresholds, *np.exp(-law.thinning * thresholds)]
