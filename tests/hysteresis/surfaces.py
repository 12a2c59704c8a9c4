"""Surfaces for tests, and references that share no code with the kernels."""

from collections.abc import Sequence
from decimal import Decimal
from itertools import pairwise
from typing import TypeVar

import numpy as np
from hypothesis import strategies as st
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from piezod.hysteresis.everett import N_MIDDLES, N_WIDTHS, SIZE
from piezod.hysteresis.everett_bounds import least_surface_slope
from piezod.hysteresis.path_relaxation import PathRelaxation

Floats = NDArray[np.float64]
Number = TypeVar("Number", float, Decimal)


def everett(coefficients: Floats, upper: float, lower: float) -> float:
    """Return E(upper, lower) by numpy's Legendre series."""
    width, middle = upper - lower, upper + lower - 1.0
    table = coefficients.reshape(N_WIDTHS, N_MIDDLES)
    return float(width * legendre.legval2d(2.0 * np.sqrt(width) - 1.0, middle, table))


def dominant_extrema(past: Sequence[Number]) -> list[Number]:
    """Return the extrema that count of drives from rest, found anew from the whole past.

    They are the drive at the start, the highest one since, the lowest after it, the highest after
    that, and so on (Mayergoyz 1991, section 1.2). The last one is the present drive.
    """
    extrema, start, seek_maximum = [past[0]], 0, True
    while start < len(past) - 1:
        rest = past[start:]
        best = max(rest) if seek_maximum else min(rest)
        extrema.append(best)
        # The last occurrence: an equal extremum deletes the earlier one.
        start += len(rest) - 1 - rest[::-1].index(best)
        seek_maximum = not seek_maximum
    return extrema


def all_pairs(coefficients: Floats, drives: Sequence[float]) -> float:
    """Return the displacement after drives from rest, as the sum over all pairs of extrema."""
    extrema, total = dominant_extrema([0.0, *drives]), 0.0
    for before, now in pairwise(extrema):
        sign = 1.0 if now >= before else -1.0
        total += sign * everett(coefficients, max(before, now), min(before, now))
    return total


def relays(coefficients: Floats, drives: Sequence[float], cells: int) -> float:
    """Return the displacement after drives by a plane of relays, each of which remembers its state.

    The weight of a relay is the integral of the density -∂²E/∂α∂β over its cell, which is a
    difference of E at four corners. Half a cell on the diagonal is E itself.
    """
    edges = np.linspace(0.0, 1.0, cells + 1)
    total, level = 0.0, 0
    up = np.zeros((cells, cells), dtype=bool)
    for drive in drives:
        new = round(drive * cells)
        # Relay (i, j) switches up when the drive passes edge i + 1, and down when it passes edge j.
        if new > level:
            up[:new, :] = True
        else:
            up[:, new:] = False
        level = new
    for i in range(cells):
        for j in range(i + 1):
            if up[i, j]:
                corners = [
                    everett(coefficients, edges[i + 1], edges[j]),
                    everett(coefficients, edges[i], edges[j]) if i > j else 0.0,
                    everett(coefficients, edges[i + 1], edges[j + 1]) if i > j else 0.0,
                    everett(coefficients, edges[i], edges[j + 1]) if i > j + 1 else 0.0,
                ]
                total += corners[0] - corners[1] - corners[2] + corners[3]
    return total


def drawn(seed: int, spread: float = 0.02) -> Floats:
    """Return a surface that can be inverted: near a line, with random bends."""
    rng = np.random.default_rng(seed)
    coefficients = np.zeros(SIZE)
    coefficients[0], coefficients[N_MIDDLES] = 0.75, 0.2
    bends = spread * rng.standard_normal(SIZE)
    while least_surface_slope(coefficients + bends) < 0.05:
        bends *= 0.7
    return coefficients + bends


def invertible_with(path: PathRelaxation, coefficients: Floats) -> Floats:
    """Return coefficients whose sum with a path can be inverted: steeper by what it takes away."""
    steeper = coefficients.copy()
    steeper[0] -= path.least_slope
    return steeper


def relaxing(h: float, move: float, decay: float, skew: float, exponent: float = 1.0) -> float:
    """Return h after a move of the drive, by numerical integration of its differential equation."""

    def slope(_z: float, h: Floats) -> Floats:
        share = (decay * (1.0 + skew) * np.abs(h)) ** (exponent - 1.0)
        bent: Floats = 1.0 - decay * (np.sign(move) * h + skew * np.abs(h)) * share
        return bent

    solution = solve_ivp(slope, (0.0, move), [h], rtol=1e-9, atol=1e-11)
    return float(solution.y[0, -1])


PATHS = st.builds(
    PathRelaxation,
    st.floats(-1.0, 1.0),
    st.floats(0.3, 30.0),
    st.floats(-0.9, 0.9),
    st.one_of(st.just(1.0), st.floats(1.0, 4.0)),
)
"""Parts that relax along the path."""
SURFACES = st.integers(0, 10_000).map(drawn)
"""Surfaces that can be inverted."""
DRIVES = st.lists(
    st.one_of(st.sampled_from([0.0, 0.25, 0.5, 1.0]), st.floats(0.0, 1.0, width=32)),
    min_size=1,
    max_size=25,
)
"""Drives, with many repeated levels: they delete extrema by equality."""
