"""Regressors of a surface with creep: what each coefficient and each lag adds to a displacement."""

import numpy as np

from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.hysteresis.everett import SIZE, surface
from piezod.hysteresis.everett_memory import advance_drive, new_surface_memory
from piezod.hysteresis.memory import (
    MAXIMUM,
    MINIMUM,
    RISING,
    FloatArray,
    IntArray,
    Memory,
)
from piezod.jit import compiled


def surface_regressors(drives: FloatArray) -> FloatArray:
    """Return the factors of the coefficients for a record of drives, shape (n, 24).

    Args:
        drives: (n,) drives in [0, 1]; the memory is relaxed before the first.
    """
    regressors = np.empty((drives.size, SIZE))
    _fill_regressors(*new_surface_memory(), np.ascontiguousarray(drives), regressors)
    return regressors


def branch_slopes(coefficients: FloatArray, drives: FloatArray) -> FloatArray:
    """Return the slope of the present branch at each drive of a record, shape (n,).

    Args:
        coefficients: (24,) coefficients.
        drives: (n,) drives in [0, 1]; the memory is relaxed before the first.
    """
    slopes = np.empty_like(drives)
    _fill_slopes(new_surface_memory(), coefficients, np.ascontiguousarray(drives), slopes)
    return slopes


def with_creep(values: FloatArray, weights: FloatArray, period_s: float) -> FloatArray:
    """Return values over time with the creep that follows them from zero, shape (n, p).

    Creep is linear: that of a sum is the sum of the creeps. It therefore acts on each regressor.

    Args:
        values: (n, p) values, evenly in time.
        weights: (K,) weight of each lag.
        period_s: Sample period, in s.
    """
    crept = np.ascontiguousarray(values).copy()
    for weight, gain in zip(weights, _gains(period_s), strict=True):
        if weight:
            _add_lag(values, gain, weight, crept)
    return crept


def lags_of(values: FloatArray, period_s: float) -> FloatArray:
    """Return all lags of the creep that follow one value over time from zero, shape (n, K).

    Args:
        values: (n,) value, evenly in time.
        period_s: Sample period, in s.
    """
    column = np.ascontiguousarray(values)[:, np.newaxis]
    lags = np.zeros((TIME_CONSTANTS_S.size, values.size, 1))
    for k, gain in enumerate(_gains(period_s)):
        _add_lag(column, gain, 1.0, lags[k])
    return lags[:, :, 0].T


def decays(n_samples: int, period_s: float) -> FloatArray:
    """Return the decay of all lags from one, shape (n, K)."""
    times_s = np.arange(n_samples) * period_s
    return np.exp(-times_s[:, np.newaxis] / TIME_CONSTANTS_S)


def _gains(period_s: float) -> FloatArray:
    return -np.expm1(-period_s / TIME_CONSTANTS_S)


@compiled
def _fill_regressors(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    drives: FloatArray,
    regressors: FloatArray,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    for k in range(drives.size):
        advance_drive(memory, 0.0, drives[k])
        for j in range(now.size):
            regressors[k, j] = now[j]


@compiled
def _fill_slopes(
    memory: Memory, coefficients: FloatArray, drives: FloatArray, slopes: FloatArray
) -> None:
    levels, counts = memory.levels, memory.counts
    for k in range(drives.size):
        drive = advance_drive(memory, 0.0, drives[k])
        if counts[RISING]:
            _, slope, _ = surface(coefficients, drive, levels[MINIMUM, counts[MINIMUM] - 1])
        else:
            _, _, slope = surface(coefficients, levels[MAXIMUM, counts[MAXIMUM] - 1], drive)
        slopes[k] = slope


@compiled
def _add_lag(values: FloatArray, gain: float, weight: float, total: FloatArray) -> None:
    # As `advance_creep`: a lag follows the value of the sample before.
    for j in range(values.shape[1]):
        lag = 0.0
        for k in range(1, values.shape[0]):
            lag += gain * (values[k - 1, j] - lag)
            total[k, j] += weight * lag
