"""Back-off before the next attempt to open a device that is absent."""

from collections.abc import Iterator
from typing import Final

FIRST_WAIT_S: Final = 0.1
LONGEST_WAIT_S: Final = 2.0


def waits_s(first_s: float = FIRST_WAIT_S, longest_s: float = LONGEST_WAIT_S) -> Iterator[float]:
    """Yield the wait before each further attempt, in s, endlessly; each is twice the one before."""
    wait_s = first_s
    while True:
        yield wait_s
        wait_s = min(2 * wait_s, longest_s)
