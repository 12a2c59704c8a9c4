"""How far a signal swung over the last cycles, in fixed memory and in the same time each cycle."""

from math import inf

_PARTS = 20  # the window slides by a twentieth of its length


class SlidingRange:
    """Highest minus lowest value over a window that slides by parts.

    The window holds the last `cycles` values, less at most a part: a twentieth of them, or one.

    Args:
        cycles: Length of the window; at least 1.
    """

    def __init__(self, cycles: int) -> None:
        self._part_cycles = max(cycles // _PARTS, 1)
        parts = max(cycles // self._part_cycles, 1)
        self._lows, self._highs = [inf] * parts, [-inf] * parts
        self._part, self._filled = 0, 0

    def add(self, value: float) -> float:
        """Take the value of this cycle; return the swing. May be called in the loop.

        Args:
            value: Finite.
        """
        if self._filled == self._part_cycles:
            self._part = (self._part + 1) % len(self._lows)
            self._lows[self._part], self._highs[self._part] = inf, -inf
            self._filled = 0
        self._filled += 1
        self._lows[self._part] = min(self._lows[self._part], value)
        self._highs[self._part] = max(self._highs[self._part], value)
        return max(self._highs) - min(self._lows)
