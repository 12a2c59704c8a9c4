"""Straight ways within limits, and the distance to them."""

from math import isnan, nan

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from piezod.coordinates.paths import distance_to_path, outside, share_within

LOW, HIGH = [0.0, -5.0, 1.0], [10.0, 5.0, 2.0]
INSIDE = st.tuples(*(st.floats(low, high) for low, high in zip(LOW, HIGH, strict=True)))
STEPS = st.tuples(*[st.floats(-30.0, 30.0)] * 3)


@given(INSIDE, STEPS)
@example((0.0, 0.0, 1.0), (0.0, 1.0, -3.6e-273))
def test_a_limit_stops_all_coordinates_together(
    start: tuple[float, ...], step: tuple[float, ...]
) -> None:
    """What is left of a step has its direction and ends within the limits, as far as they allow."""
    share = share_within(start, step, LOW, HIGH)
    assert 0.0 <= share <= 1.0
    end = [value + share * way for value, way in zip(start, step, strict=True)]
    assert outside(end, LOW, HIGH) is None
    if share < 1.0 - 1e-9:
        farther = [value + way for value, way in zip(start, step, strict=True)]
        assert outside(farther, LOW, HIGH) is not None


def test_a_coordinate_beyond_its_limit_may_only_come_back() -> None:
    """From beyond a limit a step away from it is not allowed, one back is."""
    assert share_within([11.0], [1.0], [0.0], [10.0]) == 0.0
    assert share_within([11.0], [-3.0], [0.0], [10.0]) == 1.0


def test_outside_names_the_first_coordinate() -> None:
    """A coordinate beyond its limit is named, and one that is no number, too."""
    assert outside([5.0, 6.0, 1.5], LOW, HIGH) == 1
    assert outside([nan, 0.0, 1.5], LOW, HIGH) == 0


@given(INSIDE, STEPS, st.floats(0.0, 1.0))
def test_a_point_of_a_path_is_not_off_it(
    start: tuple[float, ...], step: tuple[float, ...], share: float
) -> None:
    """Points of a straight line are on it, wherever they are."""
    end = [value + way for value, way in zip(start, step, strict=True)]
    point = [value + share * way for value, way in zip(start, step, strict=True)]
    assert distance_to_path(point, [start, end]) == pytest.approx(0.0, abs=1e-6)


def test_the_distance_to_a_path_is_the_shortest() -> None:
    """Beside a corner it counts to the nearest line; an unknown point has none."""
    corner = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]
    assert distance_to_path([5.0, 2.0], corner) == pytest.approx(2.0)
    assert distance_to_path([9.0, 7.0], corner) == pytest.approx(1.0)
    assert distance_to_path([13.0, -4.0], corner) == pytest.approx(5.0)
    assert distance_to_path([3.0, 4.0], [[0.0, 0.0]]) == pytest.approx(5.0)
    assert isnan(distance_to_path([nan, 0.0], corner))
