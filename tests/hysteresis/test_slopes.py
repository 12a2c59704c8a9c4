"""Slope coordinates and the projection onto models that can be inverted."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import InverseMPI, even_thresholds, new_bank
from piezod.hysteresis.bank import GAINS
from piezod.hysteresis.closed_form import SLOPES, branch, smallest_slope
from piezod.hysteresis.slopes import (
    LEAST_SLOPE,
    cells,
    keep_invertible,
    projected,
    smallest_slope_of,
    to_slopes,
    to_weights,
)
from tests.hysteresis.draw import UNIT, dense, inputs, thresholds

Array = NDArray[np.float64]
Model = tuple[Array, Array]
"""A bank and weights."""


@st.composite
def models(draw: st.DrawFn, most: float = 3.0) -> Model:
    """Draw a bank with different thresholds on the two sides, and weights of either sign."""
    left = draw(thresholds(most=8))
    count = len(left)
    right = draw(thresholds(most=8).filter(lambda drawn: len(drawn) >= count))[:count]
    values = st.lists(st.floats(-most, most), min_size=2 * count, max_size=2 * count)
    return new_bank(left, right), np.array(draw(values))


def branches(bank: Array, weights: Array) -> tuple[Array, Array]:
    """Return the tables of the closed form, rising and falling."""
    left, right = np.split(bank, 2, axis=1)
    plays = np.split(-weights * bank[GAINS], 2)
    return branch(left[0], plays[0]), branch(right[0], plays[1])


def inverse_of(bank: Array, weights: Array) -> InverseMPI:
    """Return the inverse model of a bank and its weights."""
    (left, right), (a_left, a_right) = np.split(bank[0], 2), np.split(weights, 2)
    return InverseMPI(right, left, a_right, a_left, capacity=64)


@given(model=models())
def test_slopes_are_those_of_the_closed_form(model: Model) -> None:
    """Row 0 is the rising branch, row 1 the falling branch from the top."""
    up, down = branches(*model)

    expected = [up[SLOPES, :-1], down[SLOPES, :-1]]

    np.testing.assert_allclose(to_slopes(*model), expected, rtol=0, atol=1e-10)


@given(model=models())
def test_slopes_sum_to_one_over_their_cells(model: Model) -> None:
    """For all weights, a major branch goes from 0 to 1."""
    heights = np.sum(to_slopes(*model) * cells(model[0]), axis=1)

    np.testing.assert_allclose(heights, 1, rtol=0, atol=1e-10)


@given(model=models())
def test_weights_come_back_from_their_slopes(model: Model) -> None:
    """Slopes and weights are equivalent coordinates."""
    bank, weights = model

    np.testing.assert_allclose(
        to_weights(bank, to_slopes(bank, weights)), weights, rtol=0, atol=1e-12
    )


@given(model=models())
def test_smallest_slope_is_that_of_the_closed_form(model: Model) -> None:
    """The condition of existence is the same in both coordinates."""
    expected = smallest_slope(*branches(*model))

    assert smallest_slope_of(*model) == pytest.approx(expected, rel=1e-12, abs=1e-10)


@given(model=models(most=100.0))
def test_projected_weights_fulfil_the_condition_to_the_last_bit(model: Model) -> None:
    """For weights of any size the projected model can be inverted."""
    bank, weights = model

    assert smallest_slope_of(bank, projected(bank, weights)) >= LEAST_SLOPE


@given(model=models())
def test_projection_leaves_its_own_result_alone(model: Model) -> None:
    """A second projection changes nothing, to the bit."""
    bank, weights = model
    once = projected(bank, weights)

    assert projected(bank, once).tolist() == once.tolist()


@given(model=models(most=0.1))
def test_weights_of_an_invertible_model_stay(model: Model) -> None:
    """The projection changes only models that violate the condition."""
    bank, weights = model
    assume(smallest_slope_of(bank, weights) >= LEAST_SLOPE)

    assert projected(bank, weights).tolist() == weights.tolist()
    assert not keep_invertible(to_slopes(bank, weights), cells(bank))


@given(model=models())
def test_projection_keeps_the_ends(model: Model) -> None:
    """Slopes still sum to one over their cells, and the kernel reports the change."""
    bank, weights = model
    assume(smallest_slope_of(bank, weights) < LEAST_SLOPE)
    slopes = to_slopes(bank, weights)

    assert keep_invertible(slopes, cells(bank))
    np.testing.assert_allclose(np.sum(slopes * cells(bank), axis=1), 1, rtol=0, atol=1e-12)


@given(model=models(), part=UNIT)
def test_a_model_at_the_edge_is_moved_little(model: Model, part: float) -> None:
    """Slopes move in proportion to the violation, so that adapting along the edge is smooth."""
    bank, weights = model
    slope = smallest_slope_of(bank, weights)
    assume(slope < LEAST_SLOPE)
    missing = 1e-6 * part
    scale = (1 - LEAST_SLOPE + missing) / (1 - slope)  # the smallest slope is linear in the weights
    slopes = to_slopes(bank, scale * weights)
    before = slopes.copy()

    keep_invertible(slopes, cells(bank))

    widest_to_narrowest = 1 / np.min(cells(bank))
    assert np.max(np.abs(slopes - before)) <= 4 * widest_to_narrowest * (missing + 1e-8)


def test_flat_cells_are_raised_and_the_others_lowered_alike() -> None:
    """The projection of the slopes is the nearest feasible model."""
    widths = np.full((2, 4), 0.25)
    slopes = np.array([[3.0, 2.0, -0.5, -0.5], [1.0, 1.0, 1.0, 1.0]])

    keep_invertible(slopes, widths)

    np.testing.assert_allclose(slopes[0], [2.45, 1.45, 0.05, 0.05], rtol=0, atol=1e-7)
    np.testing.assert_allclose(slopes[1], 1, rtol=0, atol=1e-7)


@given(
    parts=st.lists(UNIT, min_size=2, max_size=10),
    widths=st.lists(st.floats(0.05, 1), min_size=10, max_size=10),
    least=st.floats(0.5, 1),
)
def test_lifting_heights_onto_a_line_keeps_slopes_above_the_smaller_of_the_two(
    parts: list[float], widths: list[float], least: float
) -> None:
    """Max(φ(r_K), κ r_K) has no slope below min(σ, κ); the projection relies on this."""
    width = np.array(widths[: len(parts)])
    knots = np.cumsum(width) / np.sum(width)
    slopes = np.array(parts) + 0.01
    heights = np.cumsum(slopes * width)
    heights, smallest = heights / heights[-1], np.min(slopes) * np.sum(width) / heights[-1]

    lifted = np.maximum(heights, least * knots)
    after = np.diff(lifted, prepend=0.0) / np.diff(knots, prepend=0.0)

    assert np.min(after) >= min(smallest, least) - 1e-12


@given(model=models(), points=inputs(least=2))
def test_projected_model_rises_with_its_input_everywhere(model: Model, points: Array) -> None:
    """On every loop, the drive rises with a slope of at least `LEAST_SLOPE`."""
    bank, weights = model
    path = dense(points, 5)

    moves, gains = np.diff(path), np.diff(inverse_of(bank, projected(bank, weights)).run(path))

    wide = np.abs(moves) > 1e-7
    assert np.all(gains[wide] / moves[wide] >= LEAST_SLOPE - 1e-6)


@given(model=models(), values=inputs())
def test_projected_model_has_a_forward_model_that_it_undoes(model: Model, values: Array) -> None:
    """In both orders the composition is the identity on any input, minor loops included."""
    bank, weights = model
    inverse = inverse_of(bank, projected(bank, weights))
    forward = inverse.exact_inverse()

    np.testing.assert_allclose(inverse.run(forward.run(values)), values, rtol=0, atol=1e-12)
    inverse.reset()
    forward.reset()
    np.testing.assert_allclose(forward.run(inverse.run(values)), values, rtol=0, atol=1e-12)


@given(model=models())
def test_inverse_model_that_breaks_the_condition_has_no_forward_model(model: Model) -> None:
    """The message states the smallest slope."""
    bank, weights = model
    assume(smallest_slope_of(bank, weights) < -1e-6)

    with pytest.raises(ModelError, match="no inverse exists: the smallest slope of the model is -"):
        inverse_of(bank, weights).exact_inverse()


def test_the_model_without_weights_has_slope_one() -> None:
    """It is the identity, and it is invertible."""
    bank = new_bank(even_thresholds(5), even_thresholds(5))

    assert to_slopes(bank, np.zeros(10)).tolist() == np.ones((2, 6)).tolist()
    assert smallest_slope_of(bank, np.zeros(10)) == 1.0
