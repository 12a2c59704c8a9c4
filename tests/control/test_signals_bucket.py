"""Tests of the leaky bucket."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.signals import LeakyBucket


def test_bucket_trips_at_the_fifth_error_in_a_row() -> None:
    """Four errors in a row do not trip it."""
    bucket = LeakyBucket()

    assert [bucket.update(True) for _ in range(6)] == [False] * 4 + [True] * 2


@pytest.mark.parametrize(("good_between", "trips"), [(1, True), (2, False), (3, False)])
def test_bucket_trips_if_more_than_a_third_of_the_cycles_are_errors(
    good_between: int, trips: bool
) -> None:
    """Errors in every second cycle trip it; errors in every third do not."""
    bucket = LeakyBucket()

    tripped = [bucket.update(cycle % (good_between + 1) == 0) for cycle in range(1000)]

    assert any(tripped) == trips


def test_full_bucket_recovers_after_one_good_cycle() -> None:
    """The level never exceeds the trip level, however long the errors last."""
    bucket = LeakyBucket()
    for _ in range(1000):
        bucket.update(True)

    assert bucket.level == 10
    assert not bucket.update(False)


def test_bucket_starts_again_after_a_reset() -> None:
    """After `reset` it takes five errors to trip."""
    bucket = LeakyBucket()
    for _ in range(5):
        bucket.update(True)
    bucket.reset()

    assert [bucket.update(True) for _ in range(5)] == [False] * 4 + [True]


def test_level_rises_by_two_and_falls_by_one() -> None:
    """The level starts at zero, never falls below it, and is zero after `reset`."""
    bucket = LeakyBucket()
    levels = [bucket.level]
    for error in (False, True, True, False, False, False, False, False, True):
        bucket.update(error)
        levels.append(bucket.level)
    bucket.reset()

    assert levels == [0, 0, 2, 4, 3, 2, 1, 0, 0, 2]
    assert bucket.level == 0


@given(errors=st.lists(st.booleans(), max_size=200))
def test_level_stays_in_its_range(errors: list[bool]) -> None:
    """The level is between zero and the trip level for any errors."""
    bucket = LeakyBucket()

    levels = [(bucket.update(error), bucket.level)[1] for error in errors]

    assert all(0 <= level <= 10 for level in levels)
