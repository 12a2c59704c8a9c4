"""Waits for other processes, with a deadline."""

import threading
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


def join(thread: threading.Thread, within_s: float = 20.0) -> None:
    """Wait for the end of a thread."""
    thread.join(within_s)
    assert not thread.is_alive(), f"{thread.name} does not end within {within_s:g} s"
