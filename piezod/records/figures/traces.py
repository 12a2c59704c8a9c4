"""Long traces drawn with few points and without losing a spike."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from piezod.records.frozen import FloatArray

MAX_BINS: Final = 10_000
"""Bins of a decimated trace: several per pixel, so that loops keep their shape too."""


def kept_indices(*columns: FloatArray, n_bins: int = MAX_BINS) -> npt.NDArray[np.intp]:
    """Return the indices that a trace keeps: extremes and first gap of each column in each bin.

    Args:
        *columns: Coordinates of one line, each of shape (n_samples,), at least one sample.
        n_bins: Number of bins; traces of up to two samples per bin are not decimated.

    Returns:
        Rising indices, shape (n_kept,), including the first and the last sample.
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
        # With infinities in the gaps, argmin and argmax find the extremes of the valid samples.
        kept.append(starts + np.where(missing, np.inf, bins).argmin(axis=1))
        kept.append(starts + np.where(missing, -np.inf, bins).argmax(axis=1))
        kept.append((starts + missing.argmax(axis=1))[missing.any(axis=1)])
    return np.unique(np.minimum(np.concatenate(kept), n_samples - 1))


def draw_trace(axes: Axes, x: FloatArray, y: FloatArray, **style: Any) -> Line2D:
    """Draw a line over time, or along a loop, decimated if it is long.

    Args:
        axes: The panel.
        x: Abscissa, shape (n_samples,).
        y: Ordinate, same shape; NaN leaves a gap.
        **style: Arguments for `Axes.plot`.
    """
    kept = kept_indices(x, y)
    (line,) = axes.plot(x[kept], y[kept], **style)
    return line
