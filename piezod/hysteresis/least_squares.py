"""Batch identification: all weights of the inverse at once, by constrained ridge least squares.

The weights are searched among the models that can be inverted (see `slopes`). Every slope of a side
is at least 1 + ε - κ and every chord is at least κ; both are linear in the weights. This quadratic
programme with linear constraints is equivalent to a least-distance problem, which is solved as a
nonnegative least squares problem (Lawson and Hanson, Solving Least Squares Problems, chapter 23).
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
def fill_regressors(
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
    """Write E - x of all stops for a record of displacements, shape (n, 2 M). Real-time safe."""
    memory = Memory(levels, values, now, last, counts)
    for k in range(positions.size):
        position = advance_plays(memory, bank, deadband, positions[k])
        for j in range(now.size):
            regressors[k, j] = bank[GAINS, j] * (position - now[j])


def stop_regressors(
    bank: FloatArray, positions: npt.ArrayLike, deadband: float = 0.0
) -> FloatArray:
    """Return E - x of all stops for a record of displacements, shape (n, 2 M), paper eq. (29)."""
    x = checked_series(positions)
    regressors = np.empty((x.size, bank.shape[1]))
    fill_regressors(*new_bank_memory(bank), bank, deadband, x, regressors)
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

    They minimise the squared error. The resulting model can be inverted on every loop.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        positions: (n,) measured displacement in [0, 1].
        drives: (n,) drive in force at each of these samples, in [0, 1].
        ridge: Penalty on the weights, see `ridge_penalty`.
        deadband: Width of the backlash before the memory, in units of the range.

    Raises:
        ModelError: If the numbers of drives and positions differ, a value is not finite, or the
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
    """Return the number to add to the diagonal of a Gram matrix of stops, `ridge` times its mean.

    Without a penalty the condition number exceeds 1e6, and the weights fit the noise.

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
    """Return the parameters p of an invertible model that minimise ½ pᵀGp - gᵀp, shape (n,).

    Args:
        gram: (n, n) G, positive definite; n ≥ 2 M.
        right_side: (n,) g.
        bank: Thresholds and gains of the stops; the first 2 M parameters are their weights.
        nonnegative: Indices of the parameters that must not be negative.

    Raises:
        ModelError: If G is not positive definite: the record does not determine the parameters.
    """
    parameters = minimise(gram, right_side, *_constraints(bank, nonnegative, gram.shape[0]))

    weights, signed = slice(bank.shape[1]), list(nonnegative)
    # The solver keeps the constraints up to rounding; the next two lines keep them exactly.
    parameters[weights] = projected(bank, parameters[weights])
    parameters[signed] = np.maximum(parameters[signed], 0.0)
    return parameters


def minimise(
    gram: FloatArray, right_side: FloatArray, rows: FloatArray, bounds: FloatArray
) -> FloatArray:
    """Return the p that minimises ½ pᵀGp - gᵀp under A p ≥ b, shape (n,).

    The constraints hold up to rounding.

    Args:
        gram: (n, n) G, positive definite.
        right_side: (n,) g.
        rows: (k, n) A.
        bounds: (k,) b; some p must fulfil the constraints.

    Raises:
        ModelError: If G is not positive definite: the record does not determine the parameters.
    """
    factor, scale = _factor(gram)
    # With z = Lᵀ D p - L⁻¹ D⁻¹ g the objective is ½ ‖z‖², up to a constant.
    to_z = np.linalg.solve(factor, (rows / scale).T).T.astype(np.float64)
    free = np.linalg.solve(factor, right_side / scale)
    nearest = free + _least_distance(to_z, bounds - to_z @ free)
    return np.linalg.solve(factor.T, nearest) / scale


def parameter_covariance(gram: FloatArray, residual_variance: float) -> FloatArray:
    """Return the covariance of fitted parameters, shape (n, n), if no constraint binds.

    Args:
        gram: (n, n) G, with the penalties of the fit: they count as prior knowledge.
        residual_variance: Mean squared residual per independent sample.

    Raises:
        ModelError: If G is not positive definite.
    """
    factor, scale = _factor(gram)
    half = np.linalg.solve(factor, np.diag(1.0 / scale))
    return residual_variance * (half.T @ half)


def _factor(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return L and the diagonal of D with G = D L Lᵀ D, where the diagonal of L Lᵀ is one.

    The scaling by D keeps the factorisation accurate if parameters have different units.
    """
    # The smallest normal number avoids a division by zero for a parameter without effect.
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    try:
        return np.linalg.cholesky(gram / np.outer(scale, scale)), scale
    except np.linalg.LinAlgError as error:
        message = "the record does not determine the parameters: the Gram matrix is singular"
        raise ModelError(message) from error


def _constraints(
    bank: FloatArray, nonnegative: tuple[int, ...], size: int
) -> tuple[FloatArray, FloatArray]:
    """Return A and b for which A p ≥ b makes an invertible model; p has shape (size,)."""
    # Slopes and chords are linear in the weights and equal 1 if all weights are zero. The response
    # to unit vectors therefore gives the rows of A.
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

    Nonnegative least squares finds the binding constraints. The shortest z on these constraints is
    more accurate than the z from the residual of that problem.
    """
    from scipy.optimize import nnls  # noqa: PLC0415 - half a second that few commands need

    # Constraints are scaled to unit normals, so that their bounds are distances from the origin.
    lengths = np.linalg.norm(rows, axis=1)
    rows, bounds = (rows.T / lengths).T, bounds / lengths
    farthest = float(np.max(bounds))
    if farthest <= 0.0:
        return np.zeros(rows.shape[1])  # z = 0 fulfils every constraint
    # Lawson and Hanson, problem LDP: the nonzero multipliers mark the binding constraints.
    system = np.vstack((rows.T, bounds / farthest))
    target = np.append(np.zeros(rows.shape[1]), 1.0)
    binding = nnls(system, target, maxiter=30 * len(bounds))[0] > 0.0
    return np.linalg.lstsq(rows[binding], bounds[binding])[0]
