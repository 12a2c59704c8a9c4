"""Prandtl-Ishlinskii models of the inverse, classical and as modified by Kuhnen.

The inverse of a Prandtl-Ishlinskii model with nonnegative weights is again such a model, in which
the weights of the plays are negative (P. Krejci and K. Kuhnen, "Inverse control of systems with
hysteresis and creep", IEE Proc. Control Theory Appl. 148 (2001) 185). Written with the stops
E_r[x] = x - F_r[x] all of its weights are nonnegative:

    v = offset + p x + sum a_j E_rj[x],    p, a_j >= 0.

So the inverse is fitted as such, with its error in V, in place of the forward model, with its error
in µm. Both sets of models are the same, except for the places of the thresholds.
"""

import numpy as np
from scipy.optimize import least_squares, nnls

from benchmarks.peers.method import FloatArray, Method, Predictor, Rows, Series, Setting
from piezod.jit import compiled

SEARCH_SAMPLES = 4000
"""Samples from which the curve of Kuhnen's model is found; the weights come from all samples."""


@compiled
def run_stops(positions: FloatArray, radii: FloatArray, outputs: FloatArray) -> None:
    """Fill `outputs`, shape (n, m), with x - F_r[x]; each play starts at the first position."""
    for j in range(radii.size):
        play = positions[0]
        for k in range(positions.size):
            play = max(positions[k] - radii[j], min(positions[k] + radii[j], play))
            outputs[k, j] = positions[k] - play


def even_radii(count: int) -> FloatArray:
    """Return radii at equal distances; a play of radius 0.5 would stand still on [0, 1]."""
    return 0.5 * np.arange(1, count + 1) / (count + 1)


def regressors(positions: FloatArray, radii: FloatArray) -> FloatArray:
    """Return the columns offset, minus offset, x, stops; shape (n, 3 + m)."""
    stops = np.empty((positions.size, radii.size))
    run_stops(positions, radii, stops)
    ones = np.ones(positions.size)
    # Two columns with opposite signs: the weight of the offset may be negative.
    return np.column_stack((ones, -ones, positions, stops))


def nonnegative_weights(columns: FloatArray, drives: FloatArray) -> FloatArray:
    """Return the nonnegative weights with the smallest sum of squared errors."""
    # The triangular factor has the same least squares problem with few rows.
    small = np.asarray(np.linalg.qr(np.column_stack((columns, drives)), mode="r"))
    weights: FloatArray = nnls(small[:, :-1], small[:, -1])[0]
    return weights


def fit_classical(series: Series, used: Rows, setting: Setting) -> Predictor:
    """Fit the inverse of a classical Prandtl-Ishlinskii model (Krejci and Kuhnen 2001, see above).

    Its thresholds are even, its weights nonnegative.
    """
    radii = even_radii(int(setting["plays"]))
    columns = regressors(series.positions, radii)
    weights = nonnegative_weights(columns[used], series.drives[used])
    return lambda positions: regressors(positions, radii) @ weights


def curved(positions: FloatArray, log_slopes: FloatArray) -> FloatArray:
    """Return a rising curve of straight pieces through (0, 0) and (1, 1), shape (n,).

    It is a superposition of one-sided dead zones at equal distances.

    Args:
        positions: (n,) positions.
        log_slopes: (m - 1,) logarithms of the slopes of the pieces after the first one, relative
            to that of the first.
    """
    slopes = np.concatenate(((1.0,), np.exp(log_slopes)))
    knots = np.arange(slopes.size) / slopes.size
    bends = np.diff(slopes)
    curve = positions + np.maximum(positions[:, np.newaxis] - knots[1:], 0.0) @ bends
    return np.asarray(curve / np.mean(slopes))


def fit_kuhnen(series: Series, used: Rows, setting: Setting) -> Predictor:
    """Fit Kuhnen's modified Prandtl-Ishlinskii model.

    K. Kuhnen, "Modeling, identification and compensation of complex hysteretic nonlinearities: a
    modified Prandtl-Ishlinskii approach", European Journal of Control 9 (2003) 407. The forward
    model is a superposition of one-sided dead zones after the plays; in the inverse it comes before
    the stops. The slopes of the curve are searched, and for each curve the weights are the best
    nonnegative ones.
    """
    radii = even_radii(int(setting["plays"]))
    indices = np.flatnonzero(used)
    few = indices[:: max(1, indices.size // SEARCH_SAMPLES)]

    def residuals(log_slopes: FloatArray) -> FloatArray:
        columns = regressors(curved(series.positions, log_slopes), radii)[few]
        drives = series.drives[few]
        return np.asarray(columns @ nonnegative_weights(columns, drives) - drives)

    pieces = int(setting["pieces"])
    start = np.zeros(pieces - 1)
    # With one-sided differences SciPy 1.18 stops too early.
    log_slopes = least_squares(residuals, start, "3-point", x_scale=0.1, xtol=1e-10).x
    columns = regressors(curved(series.positions, log_slopes), radii)
    weights = nonnegative_weights(columns[used], series.drives[used])
    return lambda positions: regressors(curved(positions, log_slopes), radii) @ weights


CLASSICAL = Method(
    "classical PI",
    "Prandtl-Ishlinskii, even thresholds, nonnegative least squares; plays 10, 20, 40",
    fit_classical,
    tuple({"plays": plays} for plays in (10, 20, 40)),
)
KUHNEN = Method(
    "Kuhnen PI",
    "the same behind a curve of dead zones; plays 10, 20, 40, pieces 4, 8",
    fit_kuhnen,
    tuple({"plays": plays, "pieces": pieces} for plays in (10, 20, 40) for pieces in (4, 8)),
    search_stride=4,
)
