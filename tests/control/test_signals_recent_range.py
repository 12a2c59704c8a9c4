"""Tests of the range of the last cycles."""

from hypothesis import given
from hypothesis import strategies as st

from piezod.control.signals import RecentRange

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
