"""Tests of the swing over a sliding window, against the swing of all its values."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.signals import SlidingRange


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
