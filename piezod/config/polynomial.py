"""Polynomials of a calibration: evaluation, derivative and monotonicity."""

from collections.abc import Sequence
from itertools import pairwise

_HALVINGS = 200  # more than enough: a bisection of doubles ends at the last bit before


def evaluate(coefficients: Sequence[float], value: float) -> float:
    """Return c0 + c1·value + c2·value² + …. Real-time safe."""
    result = 0.0
    for coefficient in reversed(coefficients):  # Horner's rule
        result = result * value + coefficient
    return result


def derivative(coefficients: Sequence[float]) -> tuple[float, ...]:
    """Return the coefficients of the derivative."""
    return tuple(power * c for power, c in enumerate(coefficients) if power)


def is_monotonic(coefficients: Sequence[float], low: float, high: float) -> bool:
    """Return whether a polynomial rises everywhere between two values, or falls everywhere."""
    # Between two turning points a polynomial is monotonic, so comparing their values is exact.
    places = [low, *_sign_changes(derivative(coefficients), low, high), high]
    reached = [evaluate(coefficients, place) for place in places]
    steps = [later - earlier for earlier, later in pairwise(reached)]
    return all(step > 0 for step in steps) or all(step < 0 for step in steps)


def _sign_changes(coefficients: Sequence[float], low: float, high: float) -> list[float]:
    """Return the places where a polynomial changes its sign, in rising order.

    Between two neighbouring sign changes of its derivative it has at most one.
    """
    if len(coefficients) < 2:
        return []
    places = [low, *_sign_changes(derivative(coefficients), low, high), high]
    return [
        _sign_change(coefficients, left, right)
        for left, right in pairwise(places)
        if (evaluate(coefficients, left) > 0) != (evaluate(coefficients, right) > 0)
    ]


def _sign_change(coefficients: Sequence[float], left: float, right: float) -> float:
    positive_left = evaluate(coefficients, left) > 0
    for _ in range(_HALVINGS):
        middle = 0.5 * (left + right)
        if middle in (left, right):
            break
        if (evaluate(coefficients, middle) > 0) == positive_left:
            left = middle
        else:
            right = middle
    return 0.5 * (left + right)
