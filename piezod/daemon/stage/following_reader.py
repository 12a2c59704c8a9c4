"""Reads the records of a stage across exchanges of its loop."""

from collections.abc import Callable

from piezod.telemetry.arrays import Records, RingReader
from piezod.telemetry.shared_map import SharedMap


class FollowingReader:
    """Reads the ring of the present loop, also after an exchange.

    Args:
        present: Returns the memory that is shared with the present loop.
    """

    def __init__(self, present: Callable[[], SharedMap]) -> None:
        self._present, self._shared = present, present()
        self._ring = RingReader(self._shared)

    def read(self, limit: int) -> tuple[Records, int]:
        """Return the records since the last call, and the number of lost ones."""
        # An exchange makes a new ring; its records count from zero.
        if self._shared is not (present := self._present()):
            self._shared, self._ring = present, RingReader(present)
        return self._ring.read(limit)
