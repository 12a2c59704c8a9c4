"""How much of an experiment is done, for the person who waits for it."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with the present step and the share of the whole that is done, 0 to 1."""


class Meter:
    """Turns what has been done into a share of the whole.

    Args:
        progress: Called as the whole advances.
        total: All that is to be done, as `advance` counts it: seconds, or plays.

    Attributes:
        label: The present step.
    """

    def __init__(self, progress: Progress, total: float, label: str = "") -> None:
        self._progress, self._total, self._done = progress, total, 0.0
        self.label = label

    def begin(self, label: str) -> None:
        """Begin a step."""
        self.label = label
        self.advance(0.0)

    def advance(self, more: float) -> None:
        """Add what has been done since the last call."""
        self._done += more
        self._progress(self.label, min(1.0, self._done / self._total))
