"""Tests of the leaky bucket, and of the ranges of the last cycles."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.signals import LeakyBucket, RecentRange, SlidingRange


def test_bucket_trips_at_the_fifth_error_in_a_row() -> None:
    """Four errors in a row do not trip it, at the start and after `reset`."""
    bucket = LeakyBucket()

    for _ in range(2):
        assert [bucket.update(True) for _ in range(6)] == [False] * 4 + [True] * 2
        bucket.reset()


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


VALUES = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=100)


@given(VALUES, st.integers(1, 10))
def test_range_covers_the_last_cycles_and_less_than_twice_as_many(
    values: list[float], cycles: int
) -> None:
    """The range contains that of the last cycles, and lies within that of twice as many."""
    recent = RecentRange(cycles)
    for k, value in enumerate(values):
        recent.add(value)
        last, twice = (values[max(0, k + 1 - n) : k + 1] for n in (cycles, 2 * cycles))
        assert min(twice) <= recent.low <= min(last)
        assert max(last) <= recent.high <= max(twice)


def test_swing_is_zero_after_forget() -> None:
    """After `forget` the swing is that before the first value."""
    recent = RecentRange(3)
    for value in (1.0, 5.0):
        recent.add(value)
    before = recent.swing
    recent.forget()

    assert (before, recent.swing) == (4.0, 0.0)


def swing_of(values: list[float], cycles: int) -> float:
    """Return the swing of the last values."""
    last = values[-cycles:]
    return max(last) - min(last)


@given(values=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=300), cycles=st.integers(1, 100))
def test_window_holds_the_last_cycles_less_at_most_a_part(values: list[float], cycles: int) -> None:
    """The swing lies between those of the full window and of a window that is one part shorter."""
    window = SlidingRange(cycles)
    part = max(cycles // 20, 1)
    shortest = max(cycles // part * part - part + 1, 1)

    for k, value in enumerate(values, start=1):
        swing = window.add(value)

        assert swing_of(values[:k], shortest) <= swing <= swing_of(values[:k], cycles)


@pytest.mark.parametrize("cycles", [1, 2, 19, 20, 21, 39, 1000])
def test_old_swing_is_forgotten(cycles: int) -> None:
    """A swing has left the window after one length of it."""
    window = SlidingRange(cycles)
    window.add(-3.0)
    swings = [window.add(1.0) for _ in range(cycles)]

    assert swings[-1] == 0.0
