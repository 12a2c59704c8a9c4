"""Batch identification: all weights of the inverse at once, by constrained ridge least squares.

The weights are searched among the models that can be inverted (see `slopes`): every slope of a
side is at least 1 + ε - κ and every chord at least κ, which are linear in the weights. A quadratic
programme with linear constraints is a problem of least distance, and that one of nonnegative least
squares (Lawson & Hanson, Solving Least Squares Problems, chapter 23).
"""

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.bank import (
    GAINS,
    THRESHOLDS,
    advance_plays,
    checked_deadband,
    checked_series,
    new_bank_memory,
)
from piezod.hysteresis.memory import FloatArray, IntArray, Memory
from piezod.hysteresis.slopes import LEAST_CHORD, LEAST_SLOPE, cells, projected, to_slopes
from piezod.jit import compiled


@compiled
def _fill(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    deadband: float,
    positions: FloatArray,
    regressors: FloatArray,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    for k in range(positions.size):
        position = advance_plays(memory, bank, deadband, positions[k])
        for j in range(now.size):
            regressors[k, j] = bank[GAINS, j] * (position - now[j])


def stop_regressors(
    bank: FloatArray, positions: npt.ArrayLike, deadband: float = 0.0
) -> FloatArray:
    """Return E - x of every stop for a record of displacements, shape (n, 2 M)."""
    x = checked_series(positions)
    regressors = np.empty((x.size, bank.shape[1]))
    _fill(*new_bank_memory(bank), bank, deadband, x, regressors)
    return regressors


def identify_least_squares(
    bank: FloatArray,
    positions: npt.ArrayLike,
    drives: npt.ArrayLike,
    *,
    ridge: float = 1e-6,
    deadband: float = 0.0,
) -> FloatArray:
    """Return the weights [a^l, a^r], shape (2 M,), that predict the drive best.

    The model that they make can be inverted on every loop.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        positions: (n,) measured displacement in [0, 1].
        drives: (n,) drive in force when each was taken, in [0, 1].
        ridge: Penalty on the weights, see `ridge_penalty`.
        deadband: Width of the backlash before the memory, in units of the range.

    Raises:
        ModelError: If there are not as many drives as positions, a number is not finite, or the
            displacement does not move.
    """
    x, v = np.clip(checked_series(positions), 0.0, 1.0), checked_series(drives)
    if x.shape != v.shape or not np.all(np.isfinite(x + v)):
        message = f"need as many finite drives as positions, got {v.size} and {x.size}"
        raise ModelError(message)
    regressors = stop_regressors(bank, x, checked_deadband(deadband))
    gram = regressors.T @ regressors
    gram += ridge_penalty(gram, ridge) * np.eye(bank.shape[1])
    return solve_constrained(gram, regressors.T @ (v - x), bank)


def ridge_penalty(gram: FloatArray, ridge: float) -> float:
    """Return what to add to the diagonal of a Gram matrix of stops, given relative to its mean.

    Without one the condition number is above 1e6, and the weights follow the noise.

    Raises:
        ModelError: If the displacement of the record does not move.
    """
    mean = float(np.mean(np.diag(gram)))
    if mean == 0.0:
        raise ModelError("the displacement does not move: there is nothing to identify from")
    return ridge * mean


def solve_constrained(
    gram: FloatArray, right_side: FloatArray, bank: FloatArray, *, nonnegative: tuple[int, ...] = ()
) -> FloatArray:
    """Return the parameters p with the least ½ pᵀGp - gᵀp whose model can be inverted, shape (n,).

    Args:
        gram: (n, n) G, positive definite; n ≥ 2 M.
        right_side: (n,) g.
        bank: Thresholds and gains of the stops; the first 2 M parameters are their weights.
        nonnegative: Places of the parameters that must not be negative.

    Raises:
        ModelError: If G is not positive definite: the record does not determine the parameters.
    """
    factor, scale = _factor(gram)
    rows, bounds = _constraints(bank, nonnegative, gram.shape[0])
    # With z = Lᵀ D p - L⁻¹ D⁻¹ g the objective is ½ ‖z‖², up to a constant.
    to_z = np.linalg.solve(factor, (rows / scale).T).T.astype(np.float64)
    free = np.linalg.solve(factor, right_side / scale)
    nearest = free + _least_distance(to_z, bounds - to_z @ free)
    parameters = np.linalg.solve(factor.T, nearest) / scale

    weights, signed = slice(bank.shape[1]), list(nonnegative)
    parameters[weights] = projected(bank, parameters[weights])  # what is left is due to rounding
    parameters[signed] = np.maximum(parameters[signed], 0.0)
    return parameters


def parameter_covariance(gram: FloatArray, residual_variance: float) -> FloatArray:
    """Return the covariance of fitted parameters, shape (n, n), where no constraint binds.

    Args:
        gram: (n, n) G, with the penalties that the fit had: they count as knowledge.
        residual_variance: Mean squared residual per independent sample.

    Raises:
        ModelError: If G is not positive definite.
    """
    factor, scale = _factor(gram)
    half = np.linalg.solve(factor, np.diag(1.0 / scale))
    return residual_variance * (half.T @ half)


def _factor(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return L and the diagonal of D with G = D L Lᵀ D, where D makes the diagonal of L Lᵀ one."""
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    try:
        return np.linalg.cholesky(gram / np.outer(scale, scale)), scale
    except np.linalg.LinAlgError as error:
        message = "the record does not determine the parameters: the Gram matrix is singular"
        raise ModelError(message) from error


def _constraints(
    bank: FloatArray, nonnegative: tuple[int, ...], size: int
) -> tuple[FloatArray, FloatArray]:
    """Return A, b such that A p ≥ b makes an invertible model, for parameters of shape (size,).

    Slopes and chords are 1 where all weights are zero, and linear in the weights.
    """
    units = np.eye(bank.shape[1])
    slopes = np.array([to_slopes(bank, unit) for unit in units]) - 1.0
    chords = np.cumsum(slopes * cells(bank), axis=2)[:, :, :-1] / bank[THRESHOLDS].reshape(2, -1)
    slope_rows, chord_rows = slopes.reshape(len(units), -1).T, chords.reshape(len(units), -1).T
    of_weights = np.vstack((slope_rows, chord_rows))
    beyond = size - len(units)
    rows = np.vstack((np.pad(of_weights, ((0, 0), (0, beyond))), np.eye(size)[list(nonnegative)]))
    least = [LEAST_SLOPE - LEAST_CHORD, LEAST_CHORD - 1.0, 0.0]
    return rows, np.repeat(least, [len(slope_rows), len(chord_rows), len(nonnegative)])


def _least_distance(rows: FloatArray, bounds: FloatArray) -> FloatArray:
    """Return the shortest z with A z ≥ b, which exists.

    Nonnegative least squares finds which constraints bind. The shortest z on these is more exact
    than the one that its residual gives.
    """
    from scipy.optimize import nnls  # noqa: PLC0415 - half a second that few commands need

    lengths = np.linalg.norm(rows, axis=1)
    rows, bounds = (rows.T / lengths).T, bounds / lengths
    farthest = float(np.max(bounds))
    if farthest <= 0.0:
        return np.zeros(rows.shape[1])
    system = np.vstack((rows.T, bounds / farthest))
    target = np.append(np.zeros(rows.shape[1]), 1.0)
    binding = nnls(system, target, maxiter=30 * len(bounds))[0] > 0.0
    return np.linalg.lstsq(rows[binding], bounds[binding])[0]
