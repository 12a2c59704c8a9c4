"""Slope coordinates of an inverse model, and the projection onto models that can be inverted.

Between two thresholds each side of the model has one slope s_J, over a cell of width c_J = r_J -
r_{J-1} (r_0 = 0, r_{M+1} = 1). Σ s_J c_J = 1 for all weights, and

    a_J = r_J (s_J - s_{J+1}),   s_1 = 1 + Σ a_j (1 - r_j) / r_j.

s_J is ψ'_J of paper eq. (23), with its missing term and the right sign.

Let φ be a side's major branch, φ(r_K) = Σ_{J≤K} s_J c_J. From every reachable state the drive rises
with the displacement, with a slope of at least ε, if and only if

    min s (rising) + min φ(r_K) / r_K (falling) ≥ 1 + ε,   and the same with the sides exchanged.

The projection chooses σ and κ with σ + κ = 1 + ε. It makes every slope at least σ and every chord
φ(r_K) / r_K at least κ, in two steps. First the slopes become max(σ, s_J - μ), the nearest ones in
the norm Σ c_J s_J². Then the heights become max(φ(r_K), κ r_K): this makes no slope smaller than
min(σ, κ), and it changes nothing if κ < σ.
"""

import numpy as np

from piezod.hysteresis.bank import GAINS, THRESHOLDS
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled

LEAST_SLOPE = 0.05
"""ε: the smallest slope that an inverse model keeps anywhere, dimensionless."""
LEAST_CHORD = 0.95
"""κ of the convex set of models in which batch identification searches, dimensionless."""
RISING_SIDE, FALLING_SIDE = 0, 1
"""Rows of slopes: left stops from the bottom up, right stops from the top down."""

# The margin exceeds the rounding of slopes → weights → slopes, and is too small to be measured.
_TARGET_SLOPE = LEAST_SLOPE + 1e-9


@compiled
def fill_slopes(bank: FloatArray, weights: FloatArray, slopes: FloatArray) -> None:
    """Write the slopes, shape (2, M + 1), of weights, shape (2 M,): ψ' of paper eq. (23)."""
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
    """Write the weights, shape (2 M,), of slopes, shape (2, M + 1): `fill_slopes` reversed."""
    order = slopes.shape[1] - 1
    for side in range(2):
        for j in range(order):
            k = side * order + j
            weights[k] = bank[THRESHOLDS, k] * (slopes[side, j] - slopes[side, j + 1])


@compiled
def _smallest_slope(slopes: FloatArray) -> float:
    """Return the smallest slope of one side."""
    least = slopes[0]
    for j in range(1, slopes.size):
        least = min(least, slopes[j])
    return least


@compiled
def _smallest_chord(slopes: FloatArray, cells: FloatArray) -> float:
    """Return the smallest chord φ(r_K) / r_K of one side."""
    height, knot, least = 0.0, 0.0, slopes[0]
    for j in range(slopes.size):
        height += slopes[j] * cells[j]
        knot += cells[j]
        least = min(least, height / knot)
    return least


@compiled
def least_slope(slopes: FloatArray, cells: FloatArray) -> float:
    """Return the smallest slope of the model anywhere, for slopes and cells of shape (2, M + 1)."""
    rising = _smallest_slope(slopes[0]) + _smallest_chord(slopes[1], cells[1])
    falling = _smallest_slope(slopes[1]) + _smallest_chord(slopes[0], cells[0])
    return min(rising, falling) - 1.0


@compiled
def _chord_bound(slope: float, chord: float) -> float:
    """Return κ in [ε, 1], such that σ and κ exceed this slope and this chord by equal amounts."""
    return min(max(0.5 * (1.0 + _TARGET_SLOPE + chord - slope), _TARGET_SLOPE), 1.0)


@compiled
def _raise_slopes(slopes: FloatArray, cells: FloatArray, least: float) -> None:
    """Replace slopes by max(σ, s - μ), with μ such that Σ s c = 1 still holds.

    Σ c max(s - σ - μ, 0) falls with μ along a convex line of M + 1 pieces. Newton's method from the
    left therefore ends after at most M + 1 steps.
    """
    # At -inf every cell is above σ. Each step solves the sum for the cells above the last μ.
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
    # Scaling the excess over σ makes Σ s c = 1 exact again after the rounding of μ.
    total = 0.0
    for j in range(slopes.size):
        slopes[j] = max(slopes[j] - least - shift, 0.0)
        total += cells[j] * slopes[j]
    scale = (1.0 - least) / total if total > 0.0 else 0.0  # σ = 1 leaves no excess
    for j in range(slopes.size):
        slopes[j] = least + scale * slopes[j]


@compiled
def _raise_chords(slopes: FloatArray, cells: FloatArray, least: float) -> None:
    """Raise every height φ(r_K) below κ r_K to that line."""
    # Slopes are differences of the raised heights; the last height is 1 and stays, because κ ≤ 1.
    height, raised, knot = 0.0, 0.0, 0.0
    for j in range(slopes.size):
        height += slopes[j] * cells[j]
        knot += cells[j]
        before, raised = raised, max(height, least * knot)
        slopes[j] = (raised - before) / cells[j]


@compiled
def keep_invertible(slopes: FloatArray, cells: FloatArray) -> bool:
    """Project slopes in place onto invertible models; return whether they changed. Real-time safe.

    Slopes of a model whose smallest slope is `LEAST_SLOPE` or more stay the same to the bit. Other
    slopes move by an amount that vanishes with their violation of the condition. The function takes
    at most M + 1 passes over each side.

    Args:
        slopes: (2, M + 1) finite slopes with Σ s c = 1 on each side.
        cells: (2, M + 1) widths of the cells, from `cells`.
    """
    if least_slope(slopes, cells) >= LEAST_SLOPE:
        return False  # the usual case, and no rounding of a model that is fine
    smallest = (_smallest_slope(slopes[0]), _smallest_slope(slopes[1]))
    # The condition couples the slopes of one side with the chords of the other side.
    chord = (
        _chord_bound(smallest[1], _smallest_chord(slopes[0], cells[0])),
        _chord_bound(smallest[0], _smallest_chord(slopes[1], cells[1])),
    )
    for side in range(2):
        _raise_slopes(slopes[side], cells[side], 1.0 + _TARGET_SLOPE - chord[1 - side])
        _raise_chords(slopes[side], cells[side], chord[side])
    return True


def cells(bank: FloatArray) -> FloatArray:
    """Return the widths c_J of the cells of both sides of a bank, shape (2, M + 1)."""
    return np.diff(bank[THRESHOLDS].reshape(2, -1), prepend=0.0, append=1.0)


def to_slopes(bank: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the slopes s_J, shape (2, M + 1), of weights [a^l, a^r], shape (2 M,).

    Row `RISING_SIDE` is the rising major branch, set by the left stops. Row `FALLING_SIDE` is the
    falling major branch, set by the right stops and measured down from the top.
    """
    slopes = np.empty((2, weights.size // 2 + 1))
    fill_slopes(bank, weights, slopes)
    return slopes


def to_weights(bank: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the weights [a^l, a^r], shape (2 M,), of slopes, shape (2, M + 1)."""
    weights = np.empty(bank.shape[1])
    fill_weights(bank, slopes, weights)
    return weights


def smallest_slope_of(bank: FloatArray, weights: FloatArray) -> float:
    """Return the smallest slope of an inverse model anywhere, on any loop.

    The model can be inverted from every reachable state if and only if this slope is positive.
    """
    return least_slope(to_slopes(bank, weights), cells(bank))


def projected(bank: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weights, shape (2 M,), projected onto a smallest slope of at least `LEAST_SLOPE`.

    Weights that fulfil this already are returned unchanged to the bit.
    """
    slopes = to_slopes(bank, weights)
    if keep_invertible(slopes, cells(bank)):
        return to_weights(bank, slopes)
    return weights.copy()
