"""Writes vectors of surfaces to a file: `python -m tests.hysteresis.make_surface_vectors`.

They are sums over all pairs of extrema, with 50 decimal digits and with the powers of the
polynomials. Only the search for the extrema is that of other tests.
"""

import json
from collections.abc import Sequence
from decimal import Decimal, localcontext
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from tests.hysteresis.surfaces import dominant_extrema

FILE: Final = Path(__file__).with_name("surface_vectors.json")
DIGITS: Final = 50
HALVINGS: Final = 120  # of an interval of at most 1: to 1e-36
REFERENCE_RATE_PER_S: Final = Decimal("0.01")
BACKLASH: Final = Decimal("1e-4")
CYCLES_TO_REST: Final = 100

LEGENDRE: Final = (
    (1,),
    (0, 1),
    ("-0.5", 0, "1.5"),
    (0, "-1.5", 0, "2.5"),
    ("0.375", 0, "-3.75", 0, "4.375"),
    (0, "1.875", 0, "-8.75", 0, "7.875"),
)
"""Coefficients of the powers in P_0 to P_5."""

LINE: Final = [[1.0, 0.0, 0.0, 0.0], *[[0.0] * 4] * 5]
ROOTS: Final = [[0.75, 0, 0, 0], [0.2, 0, 0, 0], [0.05, 0, 0, 0], *[[0, 0, 0, 0]] * 3]
ALL: Final = [
    [0.74, 0.021, -0.013, 0.008],
    [0.19, -0.017, 0.011, -0.004],
    [0.03, 0.012, -0.007, 0.005],
    [-0.011, 0.006, 0.009, -0.003],
    [0.008, -0.005, 0.004, 0.002],
    [-0.003, 0.004, -0.002, 0.001],
]
FLAT: Final = [[0.5, *ALL[0][1:]], [0.45, *ALL[1][1:]], *ALL[2:]]
SURFACES: Final[dict[str, dict[str, Any]]] = {
    "line": {"coefficients": LINE},
    "roots": {"coefficients": ROOTS},
    "all": {"coefficients": ALL},
    "flat": {"coefficients": FLAT},
    "lag": {"coefficients": ALL, "activation": 0.004, "prompt_slope": 0.6, "period_s": 0.01},
    "path": {"coefficients": ALL, "path": {"weight": -0.12, "decay": 2.5, "skew": 0.25}},
    "path, slower at first": {
        "coefficients": ROOTS,
        "path": {"weight": 0.3, "decay": 6.0, "skew": -0.5},
    },
}
"""A straight line, wider loops for larger swings, all coefficients, a slope of 0.012 after each
reversal, a lag with the rate, and two parts that relax along the path."""

DRIVES: Final[dict[str, list[float]]] = {
    "both ends": [0.0, 0.3, 1.0, 0.6, 0.0, 0.4, 1.0, 0.0],
    "nested": [0.9, 0.2, 0.8, 0.3, 0.7, 0.4, 0.6, 0.45, 0.55, 0.5],
    "wiped out": [0.6, 0.3, 0.5, 0.4, 0.55, 0.7, 0.2, 0.6, 0.1, 0.95, 0.0],
    "repeated": [0.5, 0.25, 0.5, 0.25, 0.5, 0.25, 0.75, 0.25, 0.75, 0.75, 0.25, 0.5, 0.75],
    "touching": [1.0, 0.5, 1.0, 0.0, 0.5, 0.0, 1.0, 0.25, 1.0],
    "narrow": [0.4, 0.399999, 0.4000005, 0.39, 0.4, 0.40001, 0.3, 0.5, 0.499, 0.4995],
    "plateaus": [0.2, 0.2, 0.2, 0.1, 0.1, 0.3, 0.3, 1.0, 1.0, 0.6, 0.6],
    "growing": [0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8, 0.1, 0.9, 0.05],
}


def power_sum(powers: Sequence[int | str], x: Decimal) -> Decimal:
    """Return a polynomial at x."""
    total = Decimal(0)
    for factor in reversed(powers):
        total = total * x + Decimal(factor)
    return total


def everett(coefficients: Sequence[Sequence[float]], upper: Decimal, lower: Decimal) -> Decimal:
    """Return E(upper, lower)."""
    width, middle = upper - lower, upper + lower - 1
    root = 2 * width.sqrt() - 1
    terms = (
        Decimal(factor) * width * power_sum(LEGENDRE[i], root) * power_sum(LEGENDRE[j], middle)
        for i, row in enumerate(coefficients)
        for j, factor in enumerate(row)
    )
    return sum(terms, Decimal(0))


def lagging(before: Decimal, drive: Decimal, activation: Decimal, advance: Decimal) -> Decimal:
    """Return z of z + w asinh((z - before) / advance) = drive."""
    low, high = min(before, drive), max(before, drive)
    for _ in range(HALVINGS):
        z = (low + high) / 2
        ratio = abs(z - before) / advance
        moved = activation * (ratio + (ratio * ratio + 1).sqrt()).ln()  # asinh
        if z + moved.copy_sign(z - before) > drive:
            high = z
        else:
            low = z
    return low


def relaxed(h: Decimal, move: Decimal, decay: Decimal, skew: Decimal) -> Decimal:
    """Return h of dh = dz - b |dz| h - g dz |h| after a move, for b and g/b."""
    sign = Decimal(1).copy_sign(move)
    k, way = sign * h, abs(move)  # dk = (1 - b k - g |k|) |dz|
    if k < 0:
        slow = decay * (1 - skew)
        to_zero = (1 - slow * k).ln() / slow
        if way < to_zero:
            return sign * (1 - (1 - slow * k) * (-slow * way).exp()) / slow
        k, way = Decimal(0), way - to_zero
    fast = decay * (1 + skew)
    return sign * (1 - (1 - fast * k) * (-fast * way).exp()) / fast


def path_parts(drives: Sequence[Decimal], decay: float, skew: float) -> list[Decimal]:
    """Return h - h_0 after each drive from rest, of a drive behind a backlash."""
    b, ratio = Decimal(decay), Decimal(skew)
    at_rest = Decimal(0)
    for _ in range(CYCLES_TO_REST):
        for move in (Decimal(1), Decimal(-1)):
            at_rest = relaxed(at_rest, move, b, ratio)
    h, pinned, parts = at_rest, Decimal(0), []
    for drive in drives:
        way = abs(drive - pinned) - BACKLASH
        if way > 0:
            move = way.copy_sign(drive - pinned)
            h, pinned = relaxed(h, move, b, ratio), pinned + move
        parts.append(h - at_rest)
    return parts


def displacements(
    drives: Sequence[float],
    coefficients: Sequence[Sequence[float]],
    activation: float = 0.0,
    prompt_slope: float = 0.0,
    period_s: float = 1.0,
    path: dict[str, float] | None = None,
) -> list[float]:
    """Return the displacement after each drive from rest."""
    past, found = [Decimal(0)], []
    with localcontext() as context:
        context.prec = DIGITS
        advance = 2 * REFERENCE_RATE_PER_S * Decimal(period_s)
        exact = [Decimal(drive) for drive in drives]
        parts = [Decimal(0)] * len(exact)
        if path:
            weight = Decimal(path["weight"])
            parts = [weight * each for each in path_parts(exact, path["decay"], path["skew"])]
        for drive, part in zip(exact, parts, strict=True):
            lag = Decimal(activation)
            past.append(lagging(past[-1], drive, lag, advance) if activation else drive)
            total = part + Decimal(prompt_slope) * (drive - past[-1])
            for one, other in pairwise(dominant_extrema(past)):
                change = everett(coefficients, max(one, other), min(one, other))
                total += change if other > one else -change
            found.append(float(total))
    return found


def vectors() -> dict[str, Any]:
    """Return the surfaces, the drives, and the displacements of each surface for them."""
    return {
        "drives": DRIVES,
        "surfaces": {
            name: {
                **surface,
                "displacements": {
                    path: displacements(drives, **surface) for path, drives in DRIVES.items()
                },
            }
            for name, surface in SURFACES.items()
        },
    }


if __name__ == "__main__":
    FILE.write_text(json.dumps(vectors(), indent=1) + "\n")
