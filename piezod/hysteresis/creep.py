"""Creep: a small linear state on top of the displacement that hysteresis makes.

After a move a piezo goes on moving, by about as much in each decade of time. With y the
displacement without creep, the measured one is

    x = y + Σ w_k L_k[y],

L_k first-order lags of y whose time constants are evenly spaced on a logarithmic scale. At each
sample the lags advance with the y of the sample before, so that both directions are explicit:
adding creep to y, and removing it from x, which is exact. With w >= 0 and Σ w < 1 both are stable.

Source: Krejčí and Kuhnen, "Inverse control of systems with hysteresis and creep", IEE Proc.
Control Theory Appl. 148 (2001), for the lags; the paper has no creep.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from piezod.hysteresis.bank import checked_series
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled


class Creep(NamedTuple):
    """The creep of a stage that is sampled at an even rate.

    Attributes:
        weights: (K,) how much each lag adds to the displacement, >= 0.
        gains: (K,) part of its way that a lag goes in one sample, 1 - exp(-dt / τ), in (0, 1].
    """

    weights: FloatArray
    gains: FloatArray


NO_CREEP = Creep(np.zeros(0), np.zeros(0))


@compiled
def advance_creep(lags: FloatArray, gains: FloatArray, weights: FloatArray, before: float) -> float:
    """Advance the lags by one sample, in place; return what has crept by then.

    May be called in the loop.

    Args:
        lags: (K,) the lags; all 0 after a long rest at 0.
        gains: (K,) as in `Creep`.
        weights: (K,) as in `Creep`.
        before: Displacement without creep at the sample before; what is not finite moves no lag.
    """
    known = before - before == 0.0
    crept = 0.0
    for k in range(lags.size):
        if known:
            lags[k] += gains[k] * (before - lags[k])
        crept += weights[k] * lags[k]
    return crept


@compiled
def _remove(
    lags: FloatArray,
    gains: FloatArray,
    weights: FloatArray,
    before: float,
    positions: FloatArray,
    without: FloatArray,
) -> None:
    for k in range(positions.size):
        without[k] = positions[k] - advance_creep(lags, gains, weights, before)
        before = without[k]


@compiled
def _add(
    lags: FloatArray,
    gains: FloatArray,
    weights: FloatArray,
    before: float,
    positions: FloatArray,
    crept: FloatArray,
) -> None:
    for k in range(positions.size):
        crept[k] = positions[k] + advance_creep(lags, gains, weights, before)
        before = positions[k]


def remove_creep(
    creep: Creep, positions: npt.ArrayLike, lags: FloatArray, before: float = 0.0
) -> FloatArray:
    """Return the displacement without creep, shape (n,); `lags` advance in place.

    Args:
        creep: The creep of the stage.
        positions: (n,) measured displacement.
        lags: (K,) state of the lags, zeros after a long rest at 0; afterwards that at the end.
        before: Displacement without creep at the sample before the first.

    Raises:
        ModelError: If positions are not of shape (n,).
    """
    x = checked_series(positions)
    without = np.empty_like(x)
    _remove(lags, creep.gains, creep.weights, before, x, without)
    return without


def add_creep(
    creep: Creep, positions: npt.ArrayLike, lags: FloatArray, before: float = 0.0
) -> FloatArray:
    """Return what a displacement without creep becomes with it, shape (n,); undoes `remove_creep`.

    Arguments and errors are those of `remove_creep`, with `positions` without creep.
    """
    y = checked_series(positions)
    crept = np.empty_like(y)
    _add(lags, creep.gains, creep.weights, before, y, crept)
    return crept
