"""How long a device that is away is left alone before it is tried again."""

from collections.abc import Iterator
from typing import Final

FIRST_WAIT_S: Final = 0.1
LONGEST_WAIT_S: Final = 2.0


def waits_s(first_s: float = FIRST_WAIT_S, longest_s: float = LONGEST_WAIT_S) -> Iterator[float]:
    """Give the wait before each further try, without end: twice as long each time.

    Args:
        first_s: The first, in s.
        longest_s: The longest, in s.
    """
    wait_s = first_s
    while True:
        yield wait_s
        wait_s = min(2 * wait_s, longest_s)
