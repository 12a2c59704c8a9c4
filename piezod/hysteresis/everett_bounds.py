"""When a surface can be inverted: a proof for all loops, not only for the points of a grid.

Both slopes R and F of `everett` must be positive on the whole triangle 0 ≤ β ≤ α ≤ 1. With
t = √(α - β) and α + β - 1 = σ (1 - t²), the triangle is the rectangle 0 ≤ t ≤ 1, -1 ≤ σ ≤ 1, and
both slopes are polynomials there: of degree 11 in t and 3 in σ. A polynomial is never below the
smallest of its Bernstein coefficients (Farouki, CAGD 29 (2012), section 3.5). The rectangle is cut
into strips in t, so that this bound is close. Bernstein coefficients are linear in c. "Every
coefficient is at least ε" is therefore a set of linear inequalities, and it proves that each slope
is at least ε on every loop.
"""

from functools import lru_cache
from itertools import pairwise
from math import comb

import numpy as np

from piezod.hysteresis.everett import SIZE, surface
from piezod.hysteresis.memory import FloatArray

_DEGREES = (11, 3)
"""Degrees of the slopes in t and σ."""
_STRIPS = np.array([0.0, 0.15, 0.35, 0.6, 0.8, 1.0])


@lru_cache(maxsize=1)
def slope_rows() -> FloatArray:
    """Return the matrix B, shape (k, 24), whose product with c bounds all slopes from below.

    Every slope of a surface is at least the smallest element of B c, and at most the largest.
    """
    middles, to_middles = _nodes(_DEGREES[1], -1.0, 1.0)
    rows = []
    for low, high in pairwise(_STRIPS.tolist()):
        roots, to_roots = _nodes(_DEGREES[0], low, high)
        at_nodes = np.array([[_slopes_at(t, middle) for middle in middles] for t in roots])
        # (roots, middles, 2, 24) values become coefficients along the first two axes.
        rows.append(np.einsum("at,bs,tsij->abij", to_roots, to_middles, at_nodes))
    return np.concatenate([block.reshape(-1, SIZE) for block in rows])


def least_surface_slope(coefficients: FloatArray) -> float:
    """Return a lower bound of all slopes of a surface; its inverse exists if this is positive."""
    return float(np.min(slope_rows() @ coefficients))


def _slopes_at(root: float, middle: float) -> FloatArray:
    """Return the factors of the coefficients in both slopes at one point, shape (2, 24)."""
    half, centre = 0.5 * root * root, 0.5 * (1.0 + middle * (1.0 - root * root))
    slopes = [surface(unit, centre + half, centre - half)[1:] for unit in np.eye(SIZE)]
    return np.array(slopes).T


def _nodes(degree: int, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Return Chebyshev nodes, and the matrix from values there to Bernstein coefficients."""
    count = degree + 1
    unit = 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
    bernstein = np.array(
        [[comb(degree, k) * u**k * (1.0 - u) ** (degree - k) for k in range(count)] for u in unit]
    )
    return low + (high - low) * unit, np.linalg.inv(bernstein)
