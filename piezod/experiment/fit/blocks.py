"""Contiguous blocks of a record, each held out of a fit once.

They are contiguous, because neighbouring samples are similar.
"""

from collections.abc import Iterator

import numpy as np

from piezod.experiment.fit.problem import LinearProblem
from piezod.experiment.fit.record import Rows
from piezod.hysteresis.memory import FloatArray

BLOCKS = 5


def blocks_of(counted: Rows, blocks: int = BLOCKS) -> Iterator[Rows]:
    """Yield the mask of each block, shape (n,), in the order of time.

    Args:
        counted: (n,) mask of the samples that count.
        blocks: Number of blocks.
    """
    for places in np.array_split(np.flatnonzero(counted), blocks):
        rows = np.zeros_like(counted)
        rows[places] = True
        yield rows


def held_out_squares(fit: LinearProblem) -> FloatArray:
    """Return the mean squared miss of each block by the fit to the others, shape (blocks,)."""
    squares = []
    for rows in blocks_of(fit.counted):
        moved = fit.solved(fit.counted & ~rows) - fit.parameters
        squares.append(np.mean((fit.misses[rows] + fit.regressors[rows] @ moved) ** 2))
    return np.array(squares)


def clearly_better(
    squares: FloatArray, others: FloatArray, ratio: float, standard_errors: float
) -> bool:
    """Return whether the rms error of all blocks is smaller, and not by chance.

    The mean is mostly that of the most difficult block, which may become better by accident while
    others become worse. So the gain of each block counts as the logarithm of the ratio of its
    errors. If one block alone gains, the mean gain is one standard error.

    Args:
        squares: (blocks,) mean squared errors, above 0.
        others: (blocks,) those to compare with, above 0.
        ratio: Largest ratio of the rms errors.
        standard_errors: The mean gain must exceed this number of its standard errors.
    """
    gains = np.log(others / squares)
    smaller = float(np.mean(squares)) <= ratio**2 * float(np.mean(others))
    return smaller and float(np.mean(gains)) > standard_errors * standard_error(gains)


def standard_error(values: FloatArray) -> float:
    """Return the standard error of the mean of values, shape (n,)."""
    return float(np.std(values, ddof=1)) / float(np.sqrt(values.size))
