"""Exact discrete-time forms of the linear parts of the plant.

A linear system is advanced over one sub-step without approximation if its input is a polynomial in
time. The only error is then the difference between the polynomial and the true input. The
displacement is described by a parabola (values at the start, middle and end of the sub-step), the
light of the sensor by a cubic (values and slopes at start and end). Slopes are per sub-step, not
per second.
"""

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

# Coefficients of 1, τ, τ²/2!, … of the parabola through the values at τ = 0, 1/2, 1.
_PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [4.0, -8.0, 4.0]])
# The same for the cubic with value and slope at 0 and at 1; the last column is a constant.
_CUBIC = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 1.0],
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [-6.0, -4.0, 6.0, -2.0, 0.0],
        [12.0, 6.0, -12.0, 6.0, 0.0],
    ]
)


def exponential(matrix: Matrix) -> Matrix:
    """Return the matrix exponential, by scaling, a Taylor series and repeated squaring."""
    # The scaled norm is at most 1/4, where 17 terms of the series reach double precision.
    doublings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300)))) + 2)
    scaled = matrix / 2.0**doublings
    term = result = np.eye(len(matrix))
    for order in range(1, 18):
        term = term @ scaled / order
        result = result + term
    for _ in range(doublings):
        result = result @ result
    return result


def advance(system: Matrix, entry: Matrix, shape: Matrix) -> Matrix:
    """Discretise x' = system · x + entry · u(τ) over τ from 0 to 1.

    Args:
        system: (n, n), per sub-step.
        entry: (n,), per sub-step.
        shape: (degree + 1, m): derivatives of u at τ = 0 for each of the m numbers that describe u.

    Returns:
        (n, n + m): x at τ = 1 as a function of x at τ = 0 and of those m numbers.
    """
    n, degrees = len(system), len(shape)
    chain = np.zeros((n + degrees, n + degrees))
    chain[:n, :n] = system
    chain[:n, n] = entry
    # The derivatives of u are states too, so that the exponential also integrates the input.
    chain[n:, n:] = np.eye(degrees, k=1)  # each derivative is the rate of the one below
    solution = exponential(chain)[:n]
    return np.hstack([solution[:, :n], solution[:, n:] @ shape])


def mode(frequency_hz: float, damping: float, step_s: float) -> Matrix:
    """Return the rows that advance the first mechanical mode by one sub-step.

    Args:
        frequency_hz: Undamped frequency; infinite for a stage without the mode.
        damping: Damping ratio.
        step_s: Sub-step in s.

    Returns:
        (3, 5). Columns: displacement and slope at the start; static displacement at the start, the
        middle and the end. Rows: displacement at the end, slope at the end, slope at the start.
    """
    if np.isinf(frequency_hz):
        return np.array(
            # The displacement is the static one; its slopes are those of the parabola.
            [
                [0.0, 0.0, 0.0, 0.0, 1.0],
                [0.0, 0.0, 1.0, -4.0, 3.0],
                [0.0, 0.0, -3.0, 4.0, -1.0],
            ]
        )
    angle = 2 * pi * frequency_hz * step_s
    system = np.array([[0.0, 1.0], [-(angle**2), -2 * damping * angle]])
    end = advance(system, np.array([0.0, angle**2]), _PARABOLA)
    return np.vstack([end, [0.0, 1.0, 0.0, 0.0, 0.0]])


def receiver(bandwidth_hz: float, antialias_hz: float, step_s: float) -> Matrix:
    """Return the rows that advance detector and anti-alias filter by one sub-step.

    The detector is a first-order low-pass, the filter a second-order Butterworth low-pass.

    Args:
        bandwidth_hz: Bandwidth of the detector; infinite for an instantaneous detector.
        antialias_hz: Bandwidth of the filter; infinite for no filter.
        step_s: Sub-step in s.

    Returns:
        (3, 8). Columns: detector, filter and slope of the filter at the start; light at the start
        and its slope, light at the end and its slope; noise, constant over the sub-step. Rows:
        detector, filter and slope of the filter at the end.
    """
    if np.isinf(bandwidth_hz):
        detector = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        slope = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    else:
        rate = 2 * pi * bandwidth_hz * step_s
        detector = np.zeros(8)
        # The detector depends on itself, the light and the noise, but not on the filter.
        detector[[0, 3, 4, 5, 6, 7]] = advance(np.array([[-rate]]), np.array([rate]), _CUBIC)[0]
        slope = rate * (np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0]) - detector)
    if np.isinf(antialias_hz):
        return np.vstack([detector, detector, slope])
    angle = 2 * pi * antialias_hz * step_s
    low_pass = np.array([[0.0, 1.0], [-(angle**2), -np.sqrt(2) * angle]])
    if np.isinf(bandwidth_hz):
        filtered = np.zeros((2, 8))
        filtered[:, 1:] = advance(low_pass, np.array([0.0, angle**2]), _CUBIC)
        return np.vstack([detector, filtered])
    system = np.zeros((3, 3))
    system[0, 0] = -rate
    system[1:, 1:] = low_pass
    system[2, 0] = angle**2
    return advance(system, np.array([rate, 0.0, 0.0]), _CUBIC)


class DiscreteCreep(NamedTuple):
    """Creep as a sum of first-order lags."""

    weights: Matrix  #: Share of each lag in the displacement.
    gains: Matrix  #: Share of its distance to the input that each lag covers in one sub-step.
    at_reference: float  #: Sum of the lags 0.1 s after a unit step.


def creep(per_decade: float, step_s: float) -> DiscreteCreep:
    """Approximate 1 + γ·log10(t / 0.1 s) from 10 ms to 3 hours, with two lags per decade."""
    # Equal weights at time constants in equal ratios: the sum rises as the logarithm of time.
    times_s = 10.0 ** (np.arange(13) / 2 - 2)
    weights = np.full(len(times_s), per_decade / 2)
    at_reference = float(weights @ -np.expm1(-0.1 / times_s))
    return DiscreteCreep(weights, -np.expm1(-step_s / times_s), at_reference)
