"""Tells samples that are missing from time stamps that jitter."""

import numpy as np
from numpy.typing import NDArray

from piezod.hysteresis.memory import FloatArray

NEIGHBOURS = 9
"""Samples on each side of a long step that tell whether the stamps after it stay late."""


def periods_between(t_s: FloatArray) -> NDArray[np.int_]:
    """Return how many sample periods are between each sample and the next, shape (n - 1,).

    Args:
        t_s: (n,) times that rise, in s.
    """
    steps_s = np.diff(t_s)
    period_s = float(np.median(steps_s))
    periods = np.maximum(np.rint(steps_s / period_s), 1.0).astype(np.int_)
    # After a late stamp the next ones are on time again; after a missing sample they are not.
    long = np.flatnonzero(periods > 1)
    late = t_s / period_s - np.arange(t_s.size)
    around = long[:, np.newaxis] + np.arange(NEIGHBOURS)
    after = late[np.minimum(around + 1, t_s.size - 1)]
    before = late[np.maximum(around - NEIGHBOURS + 1, 0)]
    missing = np.rint(np.median(after, axis=1) - np.median(before, axis=1)).astype(np.int_)
    periods[long] = 1 + np.clip(missing, 0, periods[long] - 1)
    return periods
