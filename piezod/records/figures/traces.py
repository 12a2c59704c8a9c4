"""Long traces drawn with few points, none of their spikes lost."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from piezod.records.frozen import FloatArray

MAX_BINS: Final = 10_000
"""Bins of a decimated trace: several to a pixel, so that loops, too, look as they are."""


def kept_indices(*columns: FloatArray, n_bins: int = MAX_BINS) -> npt.NDArray[np.intp]:
    """Return the indices that a trace keeps: per bin each column's extremes and first gap.

    Args:
        *columns: What is drawn along one line, each of shape (n_samples,), at least one sample.
        n_bins: Bins to divide the samples into; beyond twice as many samples, they are decimated.

    Returns:
        Rising indices, shape (n_kept,), the first and the last sample among them.
    """
    n_samples = columns[0].size
    if n_samples <= 2 * n_bins:
        return np.arange(n_samples)
    width = -(-n_samples // n_bins)
    starts = np.arange(0, n_samples, width)
    kept = [np.array([0, n_samples - 1])]
    for values in columns:
        # The last bin is filled up with the last sample, which is kept anyway.
        bins = np.pad(values, (0, starts.size * width - n_samples), mode="edge").reshape(-1, width)
        missing = ~np.isfinite(bins)
        kept.append(starts + np.where(missing, np.inf, bins).argmin(axis=1))
        kept.append(starts + np.where(missing, -np.inf, bins).argmax(axis=1))
        kept.append((starts + missing.argmax(axis=1))[missing.any(axis=1)])
    return np.unique(np.minimum(np.concatenate(kept), n_samples - 1))


def draw_trace(axes: Axes, x: FloatArray, y: FloatArray, **style: Any) -> Line2D:
    """Draw a line over time, or along a loop, decimated where it is long.

    Args:
        axes: Where to draw.
        x: Abscissa, shape (n_samples,).
        y: Ordinate, same shape; NaN leaves a gap.
        **style: Passed on to `Axes.plot`.
    """
    kept = kept_indices(x, y)
    (line,) = axes.plot(x[kept], y[kept], **style)
    return line
