"""Waiting for what other processes do, with a deadline."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def eventually(condition: Callable[[], T], within_s: float = 20.0) -> T:
    """Return what a condition gives as soon as that counts as true.

    Args:
        condition: Asked again and again, every 5 ms.
        within_s: How long at most. Generous: it only says when to give up, and asserts no timing.

    Raises:
        AssertionError: If the time is over; the text has what the condition gave last.
    """
    end_s = time.monotonic() + within_s
    while not (found := condition()):
        assert time.monotonic() < end_s, f"not within {within_s:g} s, last: {found!r}"
        time.sleep(0.005)
    return found
