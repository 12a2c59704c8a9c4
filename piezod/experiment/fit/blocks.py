"""Contiguous blocks of a record, each held out of a fit once.

They are contiguous, because neighbouring samples are similar.
"""

from collections.abc import Iterator

import numpy as np

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


def standard_error(values: FloatArray) -> float:
    """Return the standard error of the mean of values, shape (n,)."""
    return float(np.std(values, ddof=1)) / float(np.sqrt(values.size))
