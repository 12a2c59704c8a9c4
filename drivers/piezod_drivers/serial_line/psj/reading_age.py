"""The age of a reading that the device refreshes seldom."""

from math import nan


class ReadingAge:
    """Dates a value by the instant at which it was first seen: each refresh changes it.

    A value that does not change in its last digit looks older than it is, but never newer.

    Args:
        refresh_ns: Time for which the device keeps a value, in ns; 0 if every reading is new.
    """

    def __init__(self, refresh_ns: int) -> None:
        self._refresh_ns = refresh_ns
        self._value, self._seen_ns = nan, -1

    def taken_ns(self, value: float, now_ns: int) -> int:
        """Return the instant since which a value was shown, at most `now_ns`. Real-time safe.

        The first value may be as old as `refresh_ns`.
        """
        if not self._refresh_ns:
            return now_ns
        if value != self._value:
            first = self._seen_ns < 0
            # The first value may have been refreshed just before, or one refresh period ago: the
            # older one is assumed.
            self._value, self._seen_ns = value, now_ns - self._refresh_ns * first
        return self._seen_ns
