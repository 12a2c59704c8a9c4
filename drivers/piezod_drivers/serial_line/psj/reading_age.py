"""How old a reading is that a device refreshes by itself, seldom."""

from math import nan


class Freshness:
    """Tells when a value was taken: when it was first seen, as it changes with every refresh.

    A value that stays the same to its last digit looks older than it is; it is never called new.

    Args:
        refresh_ns: How long the device keeps a value, in ns; 0 where every reading is a new one.
    """

    def __init__(self, refresh_ns: int) -> None:
        self._refresh_ns = refresh_ns
        self._value, self._seen_ns = nan, -1

    def taken_ns(self, value: float, now_ns: int) -> int:
        """Return the instant from which on a value was shown, `now_ns` at the latest.

        May be called in the loop. The first value may be as old as a refresh.
        """
        if not self._refresh_ns:
            return now_ns
        if value != self._value:
            first = self._seen_ns < 0
            self._value, self._seen_ns = value, now_ns - self._refresh_ns * first
        return self._seen_ns
