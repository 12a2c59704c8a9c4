"""Errors of a tracked displacement, and measures of a loop, as shares of the displacement range.

The errors cover all samples given; the caller leaves out the first period of the waveform.
"""

import numpy as np
import numpy.typing as npt

from piezod.hysteresis.memory import FloatArray


def tracking_max(command: npt.ArrayLike, position: npt.ArrayLike) -> float:
    """Return the worst |x - x_r| over the range of x; arrays of shape (n,) in one unit."""
    x, x_r = _pair(position, command)
    return float(np.max(np.abs(x - x_r)) / np.ptp(x))


def tracking_rms(command: npt.ArrayLike, position: npt.ArrayLike) -> float:
    """Return the root mean square of x - x_r over the range of x; arrays of shape (n,)."""
    x, x_r = _pair(position, command)
    return float(np.sqrt(np.mean((x - x_r) ** 2)) / np.ptp(x))


def nonlinearity(command: npt.ArrayLike, position: npt.ArrayLike) -> float:
    """Return the worst deviation from the best line x = k x_r + c over the range of x.

    This is the hysteresis error of the paper: scale, offset and a slow common drift do not count.
    Arrays have shape (n,); the units may differ.
    """
    x, x_r = _pair(position, command)
    # Centred data: the least-squares line then has the slope of the scalar products.
    centred = x_r - np.mean(x_r)
    slope = np.dot(centred, x) / np.dot(centred, centred)
    return float(np.max(np.abs(x - np.mean(x) - slope * centred)) / np.ptp(x))


def loop_width(drive: npt.ArrayLike, position: npt.ArrayLike) -> float:
    """Return the largest distance between the branches of one loop, over its displacement range.

    Args:
        drive: (n,) one period, from its lowest value up and down again.
        position: (n,) displacement, in any unit.
    """
    rising, falling = _branches(drive, position)
    return float(np.max(falling - rising))


def asymmetry(drive: npt.ArrayLike, position: npt.ArrayLike) -> float:
    """Return the largest difference between the rising branch and the mirrored falling branch.

    Both are deviations from the diagonal, over the displacement range. For a classical
    Prandtl-Ishlinskii model it is zero. Arguments as for `loop_width`.
    """
    rising, falling = _branches(drive, position)
    diagonal = np.linspace(0.0, 1.0, rising.size)
    return float(np.max(np.abs((diagonal - rising) - (falling - diagonal)[::-1])))


def _pair(position: npt.ArrayLike, command: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    return np.asarray(position, dtype=np.float64), np.asarray(command, dtype=np.float64)


def _branches(
    drive: npt.ArrayLike, position: npt.ArrayLike, points: int = 401
) -> tuple[FloatArray, FloatArray]:
    """Return both branches on an even grid of the normalised drive, themselves normalised."""
    v, x = np.asarray(drive, dtype=np.float64), np.asarray(position, dtype=np.float64)
    v = (v - np.min(v)) / np.ptp(v)
    top = int(np.argmax(v))  # end of the rising branch
    x = (x - x[0]) / (x[top] - x[0])
    grid = np.linspace(0.0, 1.0, points)
    rising = np.interp(grid, v[: top + 1], x[: top + 1])
    falling = np.interp(grid, v[top:][::-1], x[top:][::-1])
    return rising, falling
