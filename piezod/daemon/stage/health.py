"""Whether the loop runs, for the supervisor and for systemd's watchdog."""

from typing import Final

from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

HUNG_S: Final = 2.0
"""A loop without a cycle for longer than this, in s, is killed. systemd's watchdog waits
longer: it is for a supervisor that hangs itself."""
HUNG_PERIODS: Final = 5
"""The same in periods; the longer time counts."""
LONG_GAP_NS: Final = NS_PER_S // 2
"""A longer gap between two updates does not count: what stopped the supervisor may have stopped the
loop too."""


class LoopHealth:
    """Judges by its beat whether the loop runs; call `update` often.

    A late cycle counts like any other one: a device that answers slowly does not stop the loop.

    Args:
        shared: The memory shared with the loop, made for this run.
        now_ns: The present instant.
    """

    def __init__(self, shared: SharedMap, now_ns: int) -> None:
        self._words, period_ns = shared.words, shared.layout.period_ns
        self._fresh_ns = 2 * period_ns
        self._hung_ns = max(int(HUNG_S * NS_PER_S), HUNG_PERIODS * period_ns)
        self._beat_ns = 0
        self._advanced_ns = self._updated_ns = now_ns

    def update(self, now_ns: int) -> bool:
        """Return whether there were cycles since the last update or in two periods.

        The periods are for slow loops, which do not run a cycle between any two updates.
        """
        gap_ns, self._updated_ns = now_ns - self._updated_ns, now_ns
        # Count as if there had been no gap.
        if gap_ns > LONG_GAP_NS:
            self._advanced_ns += gap_ns
        beat_ns = self._words[Word.LOOP_BEAT_NS]
        if beat_ns == self._beat_ns:
            return self.started and now_ns - self._advanced_ns <= self._fresh_ns
        self._beat_ns, self._advanced_ns = beat_ns, now_ns
        return True

    @property
    def started(self) -> bool:
        """Whether there was a cycle; the first one may take its time."""
        return self._beat_ns > 0

    def hung(self, now_ns: int) -> bool:
        """Return whether a loop that ran has had no cycle for too long."""
        return self.started and now_ns - self._advanced_ns > self._hung_ns

    def age_s(self, now_ns: int) -> float:
        """Return how long ago an update found new cycles, in s."""
        return (now_ns - self._advanced_ns) / NS_PER_S
