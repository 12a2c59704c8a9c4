"""A polynomial for each direction, relative to the last turning point."""

import numpy as np

from benchmarks.peers.method import FloatArray, Method, Predictor, Rows, Series, Setting
from benchmarks.peers.turning_points import turning_points

DEGREE = 5
SMALLEST_SINGULAR = 1e-8
"""Smaller singular values, relative to the largest, count as 0: records may have few turns."""


def powers(
    positions: FloatArray, threshold: float, turn_degree: int
) -> tuple[FloatArray, FloatArray]:
    """Return the products of powers up to `DEGREE`, shape (n, m), and the direction, shape (n,).

    The factors are the way since the last turning point, and this turning point up to a degree of
    its own.
    """
    turns = turning_points(positions, 1, threshold, wipe=False)
    turn = turns.last[:, 0]
    way, place = np.vander(positions - turn, DEGREE + 1), np.vander(turn, DEGREE + 1)
    pairs = [
        way[:, DEGREE - i] * place[:, DEGREE - j]
        for i in range(DEGREE + 1)
        for j in range(min(DEGREE - i, turn_degree) + 1)
    ]
    return np.column_stack(pairs), turns.direction


def fit_branches(series: Series, used: Rows, setting: Setting) -> Predictor:
    """Fit one polynomial of degree 5 to ascending branches and one to descending ones.

    Polynomials of the branches, mapped by the turning points, are those of S. Bashash and N.
    Jalili, "A polynomial-based linear mapping strategy for feedforward compensation of hysteresis
    in piezoelectric actuators", J. Dyn. Syst. Meas. Control 130 (2008) 031008. Here the map is a
    polynomial too: that of the turning point.
    """
    threshold, turn_degree = float(setting["threshold"]), int(setting["turn degree"])
    columns, direction = powers(series.positions, threshold, turn_degree)
    coefficients = {
        sign: np.linalg.lstsq(
            columns[used & (direction == sign)],
            series.drives[used & (direction == sign)],
            rcond=SMALLEST_SINGULAR,
        )[0]
        for sign in (1.0, -1.0)
    }

    def predict(positions: FloatArray) -> FloatArray:
        columns, direction = powers(positions, threshold, turn_degree)
        rising, falling = columns @ coefficients[1.0], columns @ coefficients[-1.0]
        return np.asarray(np.where(direction > 0.0, rising, falling))

    return predict


BRANCHES = Method(
    "polynomial branches",
    "degree 5 in the way since the last turn; threshold 0.002, 0.01, turn degree 1, 2, 5",
    fit_branches,
    tuple(
        {"threshold": threshold, "turn degree": degree}
        for threshold in (0.002, 0.01)
        for degree in (1, 2, 5)
    ),
)
