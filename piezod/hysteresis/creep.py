"""Creep: a small linear dynamic that adds to the displacement of the hysteresis.

After a move a piezo continues to move, by about the same amount in each decade of time. Let y be
the displacement without creep. The measured displacement is

    x = y + Σ w_k L_k[y].

The L_k are first-order lags of y, whose time constants are evenly spaced on a logarithmic scale. At
each sample the lags advance with the y of the sample before. Adding creep to y and removing it from
x are therefore both explicit, and the removal is exact. For w >= 0 and Σ w < 1 both are stable.

Source: Krejčí and Kuhnen, "Inverse control of systems with hysteresis and creep", IEE Proc. Control
Theory Appl. 148 (2001), for the lags. The paper has no creep.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from piezod.hysteresis.bank import checked_series
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled


class Creep(NamedTuple):
    """Creep of a stage that is sampled at an even rate."""

    weights: FloatArray  #: (K,) contribution of each lag to the displacement, >= 0.
    #: (K,) share of the remaining distance that a lag covers per sample, 1 - exp(-dt / τ), in (0,
    #: 1].
    gains: FloatArray


NO_CREEP = Creep(np.zeros(0), np.zeros(0))


@compiled
def advance_creep(lags: FloatArray, gains: FloatArray, weights: FloatArray, before: float) -> float:
    """Advance the lags in place by one sample and return the creep then. Real-time safe.

    Args:
        lags: (K,) state of the lags; zeros after a long rest at 0.
        gains: (K,) as in `Creep`.
        weights: (K,) as in `Creep`.
        before: Displacement without creep at the sample before; if it is not finite, the lags stay.
    """
    known = before - before == 0.0  # False for NaN and for infinities
    crept = 0.0
    # The lags follow the sample before, so that removing creep needs no solution of an equation.
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
        before = without[k]  # a NaN propagates to this sample only; the lags skip it


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
        lags: (K,) state of the lags, zeros after a long rest at 0; afterwards their state at the
            end.
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
    """Return the displacement with creep, shape (n,); the inverse of `remove_creep`.

    Arguments and errors are those of `remove_creep`, with `positions` without creep.
    """
    y = checked_series(positions)
    crept = np.empty_like(y)
    _add(lags, creep.gains, creep.weights, before, y, crept)
    return crept
