"""The three ways to place thresholds."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import (
    even_thresholds,
    graded_thresholds,
    new_bank,
    placed_thresholds,
    to_weights,
)
from piezod.hysteresis.slopes import cells

Array = NDArray[np.float64]
Place = Callable[[int], Array]
FINE = new_bank(graded_thresholds(60), graded_thresholds(60))


def weights_of_branch(heights: Array) -> Array:
    """Return weights on the fine bank for given heights of both branches at 0 … 1."""
    widths = cells(FINE)
    return to_weights(FINE, np.diff(heights) / widths)


def rounded(knots: Array) -> Array:
    """Return heights, over knots from 0 to 1, of a branch that bends mainly near zero."""
    bent: Array = knots + 0.3 * (1 - np.exp(-30 * knots))
    return np.asarray(bent / np.max(bent))


def interpolation_error(thresholds: Array) -> float:
    """Return the worst distance of the rounded branch from straight pieces between thresholds."""
    fine, knots = np.linspace(0, 1, 4001), np.concatenate(([0.0], thresholds, [1.0]))
    return float(np.max(np.abs(rounded(fine) - np.interp(fine, knots, rounded(knots)))))


@pytest.mark.parametrize("place", [even_thresholds, graded_thresholds])
@pytest.mark.parametrize("order", [1, 2, 19, 60])
def test_thresholds_increase_and_mirror_each_other(place: Place, order: int) -> None:
    """They lie in (0, 1), symmetric about its middle."""
    r = place(order)

    assert r.shape == (order,)
    assert np.all(np.diff([0, *r, 1]) > 0)
    np.testing.assert_allclose(r, 1 - r[::-1], rtol=0, atol=1e-15)


def test_graded_thresholds_are_dense_at_both_ends() -> None:
    """Cells grow up to the middle, and the first is less than 1/40 of an even cell."""
    widths = np.diff([0, *graded_thresholds(31), 1])

    assert np.all(np.diff(widths[:16]) > 0)
    assert widths[0] < 1 / 32 / 40


@pytest.mark.parametrize("place", [even_thresholds, graded_thresholds])
def test_an_order_below_one_is_refused(place: Place) -> None:
    """The message states the given order."""
    with pytest.raises(ModelError, match="an integer of at least 1, got 0"):
        place(0)


@given(values=st.lists(st.floats(-10, 10), min_size=120, max_size=120), order=st.integers(1, 40))
def test_placed_thresholds_make_a_bank_for_any_weights(values: list[float], order: int) -> None:
    """They increase strictly inside (0, 1) on each side, so `new_bank` accepts them."""
    assert placed_thresholds(FINE, np.array(values), order).shape == (2, 2 * order)


@pytest.mark.parametrize("order", [1, 7])
def test_a_model_without_hysteresis_gets_even_thresholds(order: int) -> None:
    """If nothing bends, no place is better than another."""
    bank = placed_thresholds(FINE, np.zeros(120), order)

    np.testing.assert_allclose(bank[0].reshape(2, -1), [even_thresholds(order)] * 2, atol=1e-14)


def test_each_side_has_thresholds_where_it_bends() -> None:
    """Half of the thresholds lie in the tenth of the range in which the branch bends."""
    knots = np.concatenate(([0.0], graded_thresholds(60), [1.0]))
    early, late = rounded(knots), 1 - rounded(1 - knots)

    left, right = np.split(
        placed_thresholds(FINE, weights_of_branch(np.array([early, late])), 12)[0], 2
    )

    assert np.sum(left < 0.1) >= 6
    assert np.sum(right > 0.9) >= 6
    np.testing.assert_allclose(left, 1 - right[::-1], rtol=0, atol=1e-6)


def test_placed_thresholds_fit_a_branch_better_than_any_others() -> None:
    """The interpolation error is less than half that of even and graded thresholds."""
    knots = np.concatenate(([0.0], graded_thresholds(60), [1.0]))
    weights = weights_of_branch(np.array([rounded(knots)] * 2))

    placed = placed_thresholds(FINE, weights, 12)[0, :12]

    others = min(interpolation_error(place(12)) for place in (even_thresholds, graded_thresholds))
    assert interpolation_error(placed) < 0.5 * others
