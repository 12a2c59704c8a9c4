"""When errors are too many."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.signals import LeakyBucket


def test_it_trips_at_the_fifth_error_in_a_row() -> None:
    """Not before."""
    bucket = LeakyBucket()

    assert [bucket.update(True) for _ in range(6)] == [False] * 4 + [True] * 2


@pytest.mark.parametrize(("good_between", "trips"), [(1, True), (2, False), (3, False)])
def test_it_trips_when_more_than_a_third_are_errors(good_between: int, trips: bool) -> None:
    """Every second cycle wrong is too much, every third is not."""
    bucket = LeakyBucket()

    tripped = [bucket.update(cycle % (good_between + 1) == 0) for cycle in range(1000)]

    assert any(tripped) == trips


def test_a_full_one_has_recovered_after_one_good_cycle() -> None:
    """It holds no more than it trips at, however long the errors lasted."""
    bucket = LeakyBucket()
    for _ in range(1000):
        bucket.update(True)

    assert bucket.level == 10
    assert not bucket.update(False)


def test_an_emptied_one_starts_anew() -> None:
    """After `reset` it takes five errors again."""
    bucket = LeakyBucket()
    for _ in range(5):
        bucket.update(True)
    bucket.reset()

    assert [bucket.update(True) for _ in range(5)] == [False] * 4 + [True]


def test_it_fills_faster_than_it_leaks_and_is_empty_at_first() -> None:
    """Two up, one down, never below nothing; empty again after `reset`."""
    bucket = LeakyBucket()
    levels = [bucket.level]
    for error in (False, True, True, False, False, False, False, False, True):
        bucket.update(error)
        levels.append(bucket.level)
    bucket.reset()

    assert levels == [0, 0, 2, 4, 3, 2, 1, 0, 0, 2]
    assert bucket.level == 0


@given(errors=st.lists(st.booleans(), max_size=200))
def test_its_level_stays_between_empty_and_full(errors: list[bool]) -> None:
    """Whatever comes."""
    bucket = LeakyBucket()

    levels = [(bucket.update(error), bucket.level)[1] for error in errors]

    assert all(0 <= level <= 10 for level in levels)
