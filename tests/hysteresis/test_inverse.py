"""The inverses: when they exist, and that they invert the model."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import MPIModel
from tests.hysteresis import oracle
from tests.hysteresis.draw import (
    Sides,
    any_sides,
    dense,
    inputs,
    model,
    sides_with_slopes,
    slow_model,
)

Inputs = NDArray[np.float64]
MAJOR_LOOP = np.concatenate([np.linspace(0, 1, 201), np.linspace(1, 0, 173), np.linspace(0, 1, 57)])


def invertible_sides() -> st.SearchStrategy[Sides]:
    """Draw models in which every slope on every loop is at least 0.05."""
    drawn = sides_with_slopes(0.4)
    return drawn.filter(lambda sides: model(sides).smallest_slope >= 0.05)


def first_loops(sides: Sides) -> list[Inputs]:
    """Return a falling loop from 0 → r and a rising one from 1 → 1 - r for every threshold."""
    parts = np.linspace(0, 1, 401)
    widths = [*sides[0], *sides[1], 1.0]
    return [path for r in widths for path in (r - r * parts, 1 - r + r * parts)]


@given(sides=any_sides())
def test_smallest_slope_is_where_the_condition_says(sides: Sides) -> None:
    """The formula gives the smallest slope that the operators show on first loops."""
    assert model(sides).smallest_slope == pytest.approx(
        oracle.smallest_slope(slow_model(sides)), abs=1e-6
    )


@given(sides=any_sides(), points=inputs(least=2))
def test_no_slope_is_smaller_than_the_smallest(sides: Sides, points: Inputs) -> None:
    """For any history x rises with v by at least that slope, so a positive slope means monotone."""
    path = dense(points, 5)
    mpi = model(sides)

    moves, gains = np.diff(path), np.diff(mpi.run(path))

    wide = np.abs(moves) > 1e-7
    assert np.all(gains[wide] / moves[wide] > mpi.smallest_slope - 1e-6)


@given(sides=any_sides())
def test_output_falls_while_the_input_rises_if_the_smallest_slope_is_negative(
    sides: Sides,
) -> None:
    """The condition is necessary: one of the first loops is not monotone."""
    assume(model(sides).smallest_slope < -1e-3)
    found = []
    for path in first_loops(sides):
        mpi = model(sides)
        mpi.run([0.0, 1.0] if path[0] < path[-1] else [0.0])
        found.append(np.any(np.diff(mpi.run(path)) * np.diff(path) < 0))

    assert any(found)


def test_positive_slopes_of_both_branches_are_not_enough() -> None:
    """With r = 1/2 and q = 0.6, φ' is (0.4, 1.6), yet a fall from 0.4 to 0.3 raises x."""
    mpi = MPIModel([0.5], [0.6], [0.6])

    assert mpi.run([0.4, 0.3]) == pytest.approx([0.16, 0.18], abs=1e-15)
    assert mpi.smallest_slope == pytest.approx(-0.2, abs=1e-15)


@given(sides=sides_with_slopes(0.525))
def test_branch_slopes_above_one_half_guarantee_an_inverse(sides: Sides) -> None:
    """If both sides have s ≥ (1 + ε) / 2, every slope on every loop is at least ε."""
    assert model(sides).smallest_slope >= 0.05 - 1e-9


@given(sides=sides_with_slopes(0.05))
def test_analytic_inverse_undoes_the_major_loop(sides: Sides) -> None:
    """Its composition with the model is the identity if no branch is flatter than 0.05."""
    mpi = model(sides)

    z = mpi.inverse().run(mpi.run(MAJOR_LOOP))

    np.testing.assert_allclose(z, MAJOR_LOOP, rtol=0, atol=1e-12)


def test_analytic_inverse_is_approximate_inside_the_major_loop() -> None:
    """The breakpoints of a partial loop do not coincide there; with the exact inverse they do."""
    path = dense([0.0, 0.8, 0.3, 0.6, 0.4, 0.9, 0.1], 20)
    mpi = MPIModel([0.25, 0.5, 0.75], [0.1, 0.08, 0.06], [0.05, 0.05, 0.1])
    x = mpi.run(path)

    off = np.max(np.abs(mpi.inverse().run(x) - path))

    assert 1e-4 < off < 2e-2
    np.testing.assert_allclose(mpi.exact_inverse().run(x), path, rtol=0, atol=1e-14)


@given(sides=invertible_sides(), values=inputs())
def test_exact_inverse_undoes_the_model(sides: Sides, values: Inputs) -> None:
    """In both orders its composition with the model is the identity on any input."""
    mpi = model(sides)

    z = mpi.exact_inverse().run(mpi.run(values))
    mpi.reset()
    x = mpi.run(mpi.exact_inverse().run(values))

    np.testing.assert_allclose([z, x], [values, values], rtol=0, atol=1e-12)


def test_inverses_take_over_deadband_and_capacity() -> None:
    """Both inverses have the dead-band and the capacity of their model."""
    mpi = MPIModel([0.5], [0.1], [0.1], deadband=0.1, capacity=4)
    decaying = 0.5 + 0.5 * np.linspace(1, 0.2, 40) * (-1.0) ** np.arange(40)

    for inverse in (mpi.inverse(), mpi.exact_inverse()):
        inverse.run([0.5, 0.46, 0.5, 0.46])
        assert inverse.depth == 0
        inverse.run(decaying)
        assert inverse.merged_pairs > 0


def test_model_with_a_falling_branch_has_no_analytic_inverse() -> None:
    """The message states the branch, its slope, and the cell."""
    rising = (
        r"no inverse exists: the rising branch has a slope of -0\.2 between thresholds 0 and 1, "
        "but every slope must be positive"
    )
    with pytest.raises(ModelError, match=rising):
        MPIModel([0.3, 0.6], [0.9, 0.3], [0.0, 0.0]).inverse()
    with pytest.raises(ModelError, match=r"the falling branch .* between thresholds 1 and 2"):
        MPIModel([0.3, 0.6], [0.0, 0.0], [-0.6, 0.9]).inverse()


def test_model_that_is_not_invertible_everywhere_has_no_exact_inverse() -> None:
    """The message states the remedy; the analytic inverse exists nevertheless."""
    mpi = MPIModel([0.5], [0.6], [0.6])

    remedy = r"model is -0\.2, it must be positive on every loop; scale the weights by 0\.792"
    with pytest.raises(ModelError, match=remedy):
        mpi.exact_inverse()
    scaled = 0.6 * 0.95 / 1.2
    assert MPIModel([0.5], [scaled], [scaled]).exact_inverse().smallest_slope == pytest.approx(0.05)
    np.testing.assert_allclose(mpi.inverse().run(mpi.run(MAJOR_LOOP)), MAJOR_LOOP, atol=1e-12)
