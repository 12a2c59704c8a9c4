"""Tells errors that come again and again from the single one."""


class LeakyBucket:
    """Trips at so many errors in a row, or where they are more than a share for long.

    With the values below: five in a row, or for long more than one in three.

    Args:
        up: What an error fills in.
        down: What leaks out in a cycle without one.
        trip: The level from which on it is tripped; the bucket holds no more than that.
    """

    def __init__(self, up: int = 2, down: int = 1, trip: int = 10) -> None:
        self._up, self._down, self._trip = up, down, trip
        self.level = 0
        """What is in it now, 0 to `trip`."""

    def update(self, error: bool) -> bool:
        """Take whether this cycle had an error; return whether it is tripped; call it in the loop.

        Being full, it is no longer tripped after the first cycle without an error.
        """
        if error:
            self.level = min(self.level + self._up, self._trip)
        elif self.level:
            self.level = max(self.level - self._down, 0)
        return self.level >= self._trip

    def reset(self) -> None:
        """Empty it; may be called in the loop."""
        self.level = 0
