"""Slope coordinates of an inverse model, and the projection onto models that can be inverted.

Between two thresholds each side of the model has one slope s_J, over a cell of width
c_J = r_J - r_{J-1} (r_0 = 0, r_{M+1} = 1), and Σ s_J c_J = 1 whatever the weights:

    a_J = r_J (s_J - s_{J+1}),   s_1 = 1 + Σ a_j (1 - r_j) / r_j.

Let φ be a side's major branch, φ(r_K) = Σ_{J≤K} s_J c_J. The drive rises with the displacement from
every state that can be reached, with a slope of at least ε, if and only if

    min s (rising) + min φ(r_K) / r_K (falling) ≥ 1 + ε,   and with the sides exchanged.

Projected onto are the models whose slopes are at least some σ and whose chords φ(r_K) / r_K are at
least some κ, with σ + κ = 1 + ε, in two steps. Slopes become max(σ, s_J - μ), the nearest ones in
the norm Σ c_J s_J². Heights become max(φ(r_K), κ r_K): no slope falls below min(σ, κ) by that, and
where κ < σ nothing changes.
"""

import numpy as np

from piezod.hysteresis.bank import GAINS, THRESHOLDS
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled

LEAST_SLOPE = 0.05
"""ε: the smallest slope that an inverse model keeps anywhere, dimensionless."""
LEAST_CHORD = 0.95
"""κ of the convex set that batch identification searches, dimensionless."""
RISING_SIDE, FALLING_SIDE = 0, 1
"""Rows of slopes: left stops from the bottom up, right stops from the top down."""

_AIM = LEAST_SLOPE + 1e-9  # more than going to weights and back costs, less than can be measured


@compiled
def fill_slopes(bank: FloatArray, weights: FloatArray, slopes: FloatArray) -> None:
    """Write the slopes, shape (2, M + 1), that belong to weights, shape (2 M,)."""
    order = slopes.shape[1] - 1
    for side in range(2):
        first = 1.0
        for j in range(side * order, (side + 1) * order):
            first += weights[j] * bank[GAINS, j]
        slopes[side, 0] = first
        for j in range(order):
            k = side * order + j
            slopes[side, j + 1] = slopes[side, j] - weights[k] / bank[THRESHOLDS, k]


@compiled
def fill_weights(bank: FloatArray, slopes: FloatArray, weights: FloatArray) -> None:
    """Write the weights, shape (2 M,), that belong to slopes, shape (2, M + 1)."""
    order = slopes.shape[1] - 1
    for side in range(2):
        for j in range(order):
            k = side * order + j
            weights[k] = bank[THRESHOLDS, k] * (slopes[side, j] - slopes[side, j + 1])


@compiled
def _flattest(slopes: FloatArray) -> float:
    least = slopes[0]
    for j in range(1, slopes.size):
        least = min(least, slopes[j])
    return least


@compiled
def _flattest_chord(slopes: FloatArray, cells: FloatArray) -> float:
    height, knot, least = 0.0, 0.0, slopes[0]
    for j in range(slopes.size):
        height += slopes[j] * cells[j]
        knot += cells[j]
        least = min(least, height / knot)
    return least


@compiled
def least_slope(slopes: FloatArray, cells: FloatArray) -> float:
    """Return the smallest slope anywhere of the model with slopes and cells of shape (2, M + 1)."""
    rising = _flattest(slopes[0]) + _flattest_chord(slopes[1], cells[1])
    falling = _flattest(slopes[1]) + _flattest_chord(slopes[0], cells[0])
    return min(rising, falling) - 1.0


@compiled
def _least_chord_for(flattest: float, flattest_chord: float) -> float:
    """Return κ for two sides: σ and κ lie equally far above what they have, within [ε, 1]."""
    return min(max(0.5 * (1.0 + _AIM + flattest_chord - flattest), _AIM), 1.0)


@compiled
def _raise_slopes(slopes: FloatArray, cells: FloatArray, least: float) -> None:
    """Make slopes max(σ, s - μ), with μ such that Σ s c = 1 still holds.

    Σ c max(s - σ - μ, 0) falls with μ along a convex line of M + 1 pieces: Newton's method from the
    left ends after as many steps at most.
    """
    shift = -np.inf
    for _ in range(slopes.size):
        excess, width = least - 1.0, 0.0
        for j in range(slopes.size):
            if slopes[j] - least > shift:
                excess += cells[j] * (slopes[j] - least)
                width += cells[j]
        if excess <= shift * width:
            break
        shift = excess / width
    total = 0.0
    for j in range(slopes.size):
        slopes[j] = max(slopes[j] - least - shift, 0.0)
        total += cells[j] * slopes[j]
    scale = (1.0 - least) / total if total > 0.0 else 0.0
    for j in range(slopes.size):
        slopes[j] = least + scale * slopes[j]


@compiled
def _raise_chords(slopes: FloatArray, cells: FloatArray, least: float) -> None:
    """Lift every height φ(r_K) that lies below κ r_K onto that line."""
    height, lifted, knot = 0.0, 0.0, 0.0
    for j in range(slopes.size):
        height += slopes[j] * cells[j]
        knot += cells[j]
        before, lifted = lifted, max(height, least * knot)
        slopes[j] = (lifted - before) / cells[j]


@compiled
def keep_invertible(slopes: FloatArray, cells: FloatArray) -> bool:
    """Project slopes in place onto models that can be inverted; return whether that was needed.

    Slopes of which the smallest anywhere is `LEAST_SLOPE` or more stay as they are, to the bit;
    others move the less, the less is missing. Takes at most M + 1 passes over each side; may be
    called in the loop.

    Args:
        slopes: (2, M + 1) finite slopes with Σ s c = 1 on each side.
        cells: (2, M + 1) widths of the cells, from `cells`.
    """
    if least_slope(slopes, cells) >= LEAST_SLOPE:
        return False
    flattest = (_flattest(slopes[0]), _flattest(slopes[1]))
    chord = (
        _least_chord_for(flattest[1], _flattest_chord(slopes[0], cells[0])),
        _least_chord_for(flattest[0], _flattest_chord(slopes[1], cells[1])),
    )
    for side in range(2):
        _raise_slopes(slopes[side], cells[side], 1.0 + _AIM - chord[1 - side])
        _raise_chords(slopes[side], cells[side], chord[side])
    return True


def cells(bank: FloatArray) -> FloatArray:
    """Return the widths c_J of the cells of each side of a bank, shape (2, M + 1)."""
    return np.diff(bank[THRESHOLDS].reshape(2, -1), prepend=0.0, append=1.0)


def to_slopes(bank: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the slopes s_J, shape (2, M + 1), of weights [a^l, a^r], shape (2 M,).

    Row `RISING_SIDE` is the rising major branch, which the left stops set; row `FALLING_SIDE` is
    the falling one, set by the right stops and measured down from the top.
    """
    slopes = np.empty((2, weights.size // 2 + 1))
    fill_slopes(bank, weights, slopes)
    return slopes


def to_weights(bank: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the weights [a^l, a^r], shape (2 M,), of slopes of shape (2, M + 1)."""
    weights = np.empty(bank.shape[1])
    fill_weights(bank, slopes, weights)
    return weights


def smallest_slope_of(bank: FloatArray, weights: FloatArray) -> float:
    """Return the smallest slope that an inverse model has anywhere, on any loop.

    It can be inverted from every state that it can reach if and only if this is positive.
    """
    return least_slope(to_slopes(bank, weights), cells(bank))


def projected(bank: FloatArray, weights: FloatArray) -> FloatArray:
    """Return weights of a model whose smallest slope anywhere is `LEAST_SLOPE` or more.

    Those that fulfil this are returned as they are, to the bit; shape (2 M,).
    """
    slopes = to_slopes(bank, weights)
    if keep_invertible(slopes, cells(bank)):
        return to_weights(bank, slopes)
    return weights.copy()
