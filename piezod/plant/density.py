"""Everett functions as tables, integrated from a density of relays.

The Everett function of a density μ is its integral over the triangle of all relays that switch
while the drive rises from β to α. The table has it on a square grid of α and β. Below the diagonal
it is mirrored, so that an interpolation near the diagonal has neighbours on both sides.
"""

from functools import lru_cache
from typing import Final

import numpy as np

from piezod.plant.laws import Array, ExponentialDensity, GaussianDensity

SPACING: Final = 0.005
"""Distance of two nodes, in nominal drives."""
FIRST: Final = -0.205
"""Drive of the first node: one node outside of the range, for the interpolation at its end."""
NODES: Final = 283

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_AT, _SHARE = (_POINTS + 1) / 2, _WEIGHTS / 2  # Gauss-Legendre from 0 to 1


@lru_cache(maxsize=8)  # a specimen is built more than once: it is checked before it is used
def everett_table(law: ExponentialDensity | GaussianDensity) -> Array:
    """Integrate a density over the range of the drive.

    Args:
        law: Density of the relays.

    Returns:
        (NODES, NODES): Everett function at α (rows) and β (columns), 1 at α = 1 and β = 0.
    """

    def density(upper: Array, lower: Array) -> Array:
        return law.density(upper - lower, (upper + lower) / 2)

    start = FIRST + SPACING * np.arange(NODES - 1)
    cells = np.zeros((NODES - 1, NODES - 1))
    rows, columns = np.tril_indices(NODES - 1, -1)
    diagonal = np.diag_indices(NODES - 1)
    for x, of_x in zip(_AT, _SHARE, strict=True):
        for y, of_y in zip(_AT, _SHARE, strict=True):
            upper, lower = start[rows] + x * SPACING, start[columns] + y * SPACING
            cells[rows, columns] += of_x * of_y * density(upper, lower)
            # Half a cell on the diagonal: β from the start of the cell to α.
            upper, lower = start + x * SPACING, start + x * y * SPACING
            cells[diagonal] += of_x * of_y * x * density(upper, lower)
    table = np.zeros((NODES, NODES))
    # The sum over all cells between β and α: relays below the diagonal do not exist.
    table[1:, :-1] = np.cumsum(np.cumsum(cells, axis=0)[:, ::-1], axis=1)[:, ::-1]
    table += table.T
    one, zero = round((1 - FIRST) / SPACING), round(-FIRST / SPACING)
    table /= table[one, zero]
    table.flags.writeable = False  # it is shared
    return table
