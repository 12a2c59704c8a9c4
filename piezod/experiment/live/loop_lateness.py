"""Lateness of the loop of a running stage, from its telemetry."""

from typing import Final

from piezod.config.faults import Fault
from piezod.experiment.lateness import Lateness
from piezod.messages.telemetry import Telemetry

_HOLDING: Final = frozenset({Fault.L2, Fault.L5})
"""Lateness that holds a stage."""
_OFTEN_LATE: Final = Fault.L7
_LATE_REPLIES: Final = frozenset({Fault.B5, Fault.B7, Fault.S6})
"""Late answers of devices; while the loop is often late, that is the computer's lateness."""


class LoopLateness:
    """Adds up the lateness of intervals."""

    def __init__(self) -> None:
        self._sum, self._skipped_before = Lateness(), -1

    def add(self, interval: Telemetry) -> None:
        """Add an interval; skipped cycles between two intervals count with the later one."""
        now = interval.skipped_cycles
        before = self._skipped_before if self._skipped_before >= 0 else now
        skipped, self._skipped_before = max(now - before, 0), now  # a new loop counts from 0
        faults = {str(fault) for fault in interval.faults}
        held = bool(faults & _HOLDING) or (_OFTEN_LATE in faults and bool(faults & _LATE_REPLIES))
        self._sum = self._sum.plus(Lateness(interval.cycles + skipped, skipped, held=held))

    def take(self) -> Lateness:
        """Return the lateness since the last call."""
        taken, self._sum = self._sum, Lateness()
        return taken
