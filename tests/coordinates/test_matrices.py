"""Small matrices."""

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.coordinates.matrices import Matrix, condition, from_rows, inverse, product, times

SIZES = st.integers(1, 5)
ENTRIES = st.floats(-1.0, 1.0)


@st.composite
def dominant(draw: st.DrawFn) -> Matrix:
    """Draw a matrix that can be inverted: its diagonal exceeds the rest of each row."""
    size = draw(SIZES)
    rows = draw(
        st.lists(st.lists(ENTRIES, min_size=size, max_size=size), min_size=size, max_size=size)
    )
    return tuple(
        tuple(value / size * 0.9 if i != j else 1.0 + abs(value) for j, value in enumerate(row))
        for i, row in enumerate(rows)
    )


@given(dominant(), st.data())
def test_an_inverse_brings_each_vector_back(matrix: Matrix, data: st.DataObject) -> None:
    """The inverse of a matrix undoes it."""
    size = len(matrix)
    vector = data.draw(st.lists(st.floats(-1e3, 1e3), min_size=size, max_size=size))
    back = inverse(matrix)
    assert back is not None
    assert times(back, times(matrix, vector)) == pytest.approx(vector, abs=1e-8)
    assert times(product(back, matrix), vector) == pytest.approx(vector, abs=1e-8)


@given(dominant(), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_units_do_not_change_a_condition(matrix: Matrix, row: float, column: float) -> None:
    """The condition is at least 1; units of a row or a column count little, though far apart."""
    scaled = tuple(
        tuple(
            value * (row if i == 0 else 1.0) * (column if j == 0 else 1.0)
            for j, value in enumerate(each)
        )
        for i, each in enumerate(matrix)
    )
    assert condition(matrix) >= 1.0 - 1e-12
    assert condition(scaled) <= 200.0 * condition(matrix)


def test_a_singular_matrix_has_no_inverse() -> None:
    """Equal rows and zeros have no inverse; nearly equal rows enlarge errors."""
    assert inverse(((1.0, 2.0), (1.0, 2.0))) is None
    assert condition(((1.0, 1.0), (1.0, 1.0))) == inf
    assert condition(((0.0, 0.0), (1.0, 1.0))) == inf
    assert condition(((1.0, 1.0), (1.0, 1.001))) > 1000.0


def test_rows_are_placed_by_name() -> None:
    """A number that no row names is 0."""
    rows = {"b": {"y": 2.0}, "a": {"x": 1.0, "y": 3.0}}
    assert from_rows(rows, ("a", "b"), ("x", "y")) == ((1.0, 3.0), (0.0, 2.0))
