"""Reports a doubt about the voltage of an axis a few times, however often the evidence changes."""

from typing import Final

from piezod.control.in_force import InForce, Source
from piezod.units import NS_PER_S

OVER_NS: Final = NS_PER_S
"""A doubt is over when read-back and last write have agreed for this long."""


class AxisDoubt:
    """The doubt about the voltage of one axis. Real-time safe.

    Evidence close to a limit may decide otherwise in every cycle. So each finding is reported once
    until the doubt is over; then its end is reported, too.
    """

    def __init__(self) -> None:
        self.text = ""
        """The last doubt, for people; empty if read-back and last write agree."""
        self._reported = set[Source]()
        self._agrees_ns: int | None = None

    def found(self, found: InForce) -> str:
        """Take a finding of the judge; return what to report, empty if it was reported before."""
        self.text, self._agrees_ns = found.doubt, None
        if not found.doubt or found.source in self._reported:
            return ""
        self._reported.add(found.source)
        return found.doubt

    def agrees(self, t_ns: int) -> bool:
        """Take a cycle in which both agree; return whether the doubt is over."""
        self.text = ""
        if not self._reported:
            return False
        if self._agrees_ns is None:
            self._agrees_ns = t_ns
        if t_ns - self._agrees_ns < OVER_NS:
            return False
        self._reported.clear()
        return True
