"""The lowest and the highest value of the last cycles, in fixed memory and in constant time."""

from math import inf


class RecentRange:
    """Lowest and highest value over the last cycles: over `cycles` at least, under twice as many.

    Args:
        cycles: At least 1.
    """

    def __init__(self, cycles: int) -> None:
        self._cycles = cycles
        self.low, self.high = inf, -inf
        """Lowest and highest value; the lowest is the larger where there was none yet."""
        self._low_now, self._high_now = inf, -inf
        self._low_before, self._high_before = inf, -inf
        self._filled = 0

    @property
    def swing(self) -> float:
        """Highest minus lowest value, at least 0."""
        return max(self.high - self.low, 0.0)

    def add(self, value: float) -> None:
        """Take the value of this cycle, finite; may be called in the loop."""
        if self._filled == self._cycles:
            self._low_before, self._high_before = self._low_now, self._high_now
            self._low_now = self._high_now = value
            self._filled = 0
        self._filled += 1
        self._low_now, self._high_now = min(self._low_now, value), max(self._high_now, value)
        self.low = min(self._low_before, self._low_now)
        self.high = max(self._high_before, self._high_now)

    def forget(self) -> None:
        """Forget all values; may be called in the loop."""
        self.low = self._low_before = self._low_now = inf
        self.high = self._high_before = self._high_now = -inf
        self._filled = 0
