"""Waits for other processes, with a deadline."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def eventually(condition: Callable[[], T], within_s: float = 20.0) -> T:
    """Return the value of a condition as soon as it is true.

    Args:
        condition: Called every 5 ms.
        within_s: Longest wait, in s: a generous one, which only ends a failing test.

    Raises:
        AssertionError: If the time is over; the text has the last value.
    """
    end_s = time.monotonic() + within_s
    while not (found := condition()):
        assert time.monotonic() < end_s, f"not within {within_s:g} s, last: {found!r}"
        time.sleep(0.005)
    return found
