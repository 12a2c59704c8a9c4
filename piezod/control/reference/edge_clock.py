"""The time of a motion that waits for edges: it stands still at each wait until an edge comes."""

from itertools import chain
from math import inf

from piezod.messages.requests import LineEdges
from piezod.units import NS_PER_S, s_to_ns


class EdgeClock:
    """Converts the time since the start of a motion to the time of the motion. Real-time safe.

    Args:
        edges: The edges for which it waits.
        begins_ns: Time from the start of the motion to the begin of its waveforms, in ns.
    """

    def __init__(self, edges: LineEdges, begins_ns: int) -> None:
        first, every = begins_ns + s_to_ns(edges.first_s), s_to_ns(edges.every_s)
        self._within_ns = s_to_ns(edges.within_s)
        self._gates = chain(range(first, first + edges.times * every, every), [inf])
        self._gate_ns = next(self._gates)
        self._held_ns = 0
        self._high: bool | None = None
        self.waiting = self.ended = False
        """Whether it waits for an edge, and whether it has ended because none came."""

    def advance(self, t_ns: int, *, high: bool) -> bool | None:
        """Take the level of the line in a cycle, at a time since the start, in ns.

        Returns:
            Whether it has waited for the rising edge of this cycle; None without an edge.
        """
        rises = high and self._high is False
        self._high = high
        over_ns = t_ns - self._held_ns - self._gate_ns
        self.waiting = over_ns >= 0
        if self.ended:
            return None
        if not self.waiting:
            return False if rises else None
        if rises:
            self._held_ns += int(over_ns)
            self._gate_ns, self.waiting = next(self._gates), False
            return True
        self.ended = over_ns > self._within_ns
        return None

    def at_ns(self, t_ns: float) -> float:
        """Return the time of the motion, in ns."""
        return min(t_ns - self._held_ns, self._gate_ns)

    def at_s(self, t_s: float) -> float:
        """Return the time of the motion, in s."""
        return self.at_ns(t_s * NS_PER_S) / NS_PER_S
