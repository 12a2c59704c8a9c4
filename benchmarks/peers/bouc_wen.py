"""The Bouc-Wen model of the inverse, with a cubic polynomial."""

import numpy as np
from scipy.optimize import least_squares

from benchmarks.peers.method import FloatArray, Method, Predictor, Rows, Series, Setting
from piezod.jit import compiled

SUBSTEPS = 4
"""Steps of the second-order integration between two samples."""
STARTS = (2.0, 8.0, 32.0)
"""Initial values of β + γ and β - γ; the best solution counts."""
LOWEST, HIGHEST = (-3.0, -9.0, 0.0), (7.0, 7.0, 1.5)
"""Bounds of the logarithms of β + γ, β - γ and n: the ranges in which h is bounded."""


@compiled
def slope(h: float, rising: bool, sum_: float, difference: float, power: float) -> float:
    """Return dh/dx of the model, with the sum and the difference of β and γ."""
    bent = abs(h) ** power
    bend: float = -sum_ * bent if (h >= 0.0) == rising else difference * bent
    return 1.0 + bend


@compiled
def run_bouc_wen(
    positions: FloatArray, sum_: float, difference: float, power: float, outputs: FloatArray
) -> None:
    """Fill `outputs`, shape (n,), with h, which starts at 0."""
    h = 0.0
    outputs[0] = h
    for k in range(1, positions.size):
        dx = (positions[k] - positions[k - 1]) / SUBSTEPS
        for _ in range(SUBSTEPS):
            middle = h + 0.5 * dx * slope(h, dx > 0.0, sum_, difference, power)
            h += dx * slope(middle, dx > 0.0, sum_, difference, power)
        outputs[k] = h


def regressors(positions: FloatArray, logarithms: FloatArray) -> FloatArray:
    """Return the columns 1, x, x², x³ and h, scaled to a largest value of 1; shape (n, 5)."""
    h = np.empty_like(positions)
    sum_, difference, power = np.exp(logarithms)
    run_bouc_wen(positions, sum_, difference, power, h)
    # |h| stays below its limit at which dh/dx = 0.
    return np.column_stack((np.vander(positions, 4), h * sum_ ** (1.0 / power)))


def fit_bouc_wen(series: Series, used: Rows, setting: Setting) -> Predictor:
    """Fit a Bouc-Wen model with a cubic polynomial, v = c0 + c1 x + c2 x² + c3 x³ + d h.

    dh = dx - β |dx| |h|^(n-1) h - γ dx |h|^n: Y.-K. Wen, "Method for random vibration of hysteretic
    systems", J. Eng. Mech. 102 (1976) 249; for piezo actuators T. S. Low and W. Guo, J.
    Microelectromech. Syst. 4 (1995) 230. As a model of the inverse from displacement to voltage it
    needs no inversion. β, γ and n are searched; for each of them the coefficients are the best.
    """
    drives = series.drives[used]

    def solved(logarithms: FloatArray) -> tuple[FloatArray, FloatArray]:
        columns = regressors(series.positions, logarithms)[used]
        coefficients = np.asarray(np.linalg.lstsq(columns, drives, rcond=None)[0], np.float64)
        return coefficients, columns @ coefficients - drives

    searches = [
        least_squares(
            lambda logarithms: solved(logarithms)[1],
            np.log((start, start, float(setting["first n"]) + 0.1)),
            bounds=(LOWEST, HIGHEST),
            x_scale=0.3,
        )
        for start in STARTS
    ]
    logarithms = min(searches, key=lambda search: float(search.cost)).x
    coefficients, _ = solved(logarithms)
    return lambda positions: regressors(positions, logarithms) @ coefficients


BOUC_WEN = Method(
    "Bouc-Wen",
    "with a cubic polynomial, by least_squares from three starts; first n 1, 2",
    fit_bouc_wen,
    tuple({"first n": n} for n in (1, 2)),
    search_stride=4,
)
