"""When a position counts as reached: close enough, for long enough."""


class OnTarget:
    """Watches the measured position of one axis.

    Args:
        tolerance_um: Largest error, in µm.
        settle_cycles: For how many cycles the error stays below that.
    """

    def __init__(self, tolerance_um: float, settle_cycles: int) -> None:
        self._tolerance_um, self._settle_cycles = tolerance_um, settle_cycles
        self._cycles = 0

    def restart(self) -> None:
        """Wait for another position; may be called in the loop."""
        self._cycles = 0

    def update(self, error_um: float) -> bool:
        """Take the error of a cycle, NaN for none; return whether the position is reached.

        May be called in the loop.
        """
        close = abs(error_um) <= self._tolerance_um
        self._cycles = self._cycles + 1 if close else 0
        return self._cycles > self._settle_cycles
