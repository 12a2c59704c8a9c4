"""The cycles of a session: each waited for, and asked how late it is."""

from collections.abc import Set
from typing import Final

from piezod.control.watch.loop import LATE_PART
from piezod.daemon.clock import Clock
from piezod.daemon.loop.pacer import Pacer
from piezod.devices.status import DeviceFlag
from piezod.experiment.lateness import Lateness
from piezod.units import NS_PER_S

NO_REPLY: Final = frozenset({DeviceFlag.LATE_REPLY, DeviceFlag.BUS_OVERLOADED})
"""Flags of an exchange whose reply did not come, or was not read, in time."""


class SessionCycles:
    """Waits for each cycle and counts the late ones."""

    def __init__(self, clock: Clock, rate_hz: float) -> None:
        self.period_ns = round(NS_PER_S / rate_hz)
        self._now_ns, self._pacer = clock.now_ns, Pacer(clock, self.period_ns, 0)
        self._deadline_ns = clock.now_ns()
        self.lateness = Lateness()
        """Lateness of the cycles so far."""

    def wait(self) -> bool:
        """Wait for the next cycle; return whether periods were lost before it."""
        due_ns = self._deadline_ns + self.period_ns
        had_to_wait = self._now_ns() < due_ns
        tick = self._pacer.wait()
        self._deadline_ns, late_ns, skipped = tick.deadline_ns, tick.late_ns, tick.skipped
        began_late = overran = 0
        if not had_to_wait:
            overran = skipped  # by slow devices, or by a computer that had no time for the cycle
        elif self._deadline_ns + late_ns - due_ns > LATE_PART * self.period_ns:
            began_late = max(skipped, 1)
        self.lateness = self.lateness.plus(Lateness(1 + skipped, began_late, overran))
        return skipped > 0

    def note(self, flags: Set[DeviceFlag]) -> bool:
        """Count a missing reply, by the flags of the devices; return whether one is missing."""
        missing = bool(flags & NO_REPLY)
        self.lateness = self.lateness.plus(Lateness(unanswered=int(missing)))
        return missing
