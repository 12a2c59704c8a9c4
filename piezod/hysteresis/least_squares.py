"""Batch identification: all weights of the inverse at once, by ridge least squares."""

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.bank import (
    GAINS,
    advance_plays,
    checked_deadband,
    checked_series,
    new_bank_memory,
)
from piezod.hysteresis.memory import FloatArray, IntArray, Memory
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

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        positions: (n,) measured displacement in [0, 1].
        drives: (n,) drive in force when each was taken, in [0, 1].
        ridge: Penalty on the weights, relative to the mean of the Gram matrix's diagonal; its
            condition number without one is above 1e6.
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
    penalty = ridge * float(np.mean(np.diag(gram)))
    if penalty == 0.0:
        raise ModelError("the displacement does not move: there is nothing to identify from")
    right_side = regressors.T @ (v - x)
    return np.linalg.solve(gram + penalty * np.eye(bank.shape[1]), right_side).astype(np.float64)
