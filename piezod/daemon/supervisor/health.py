"""Whether the loop runs, as its supervisor and systemd's watchdog want to know."""

from typing import Final

from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

HUNG_S: Final = 2.0
"""A loop without a healthy cycle for so long is killed. systemd's watchdog is slower: it is for a
supervisor that hangs itself."""
HUNG_PERIODS: Final = 5
BLINK_NS: Final = NS_PER_S // 2
"""A pause between two looks that is longer tells nothing of the loop: what stopped the supervisor
may have stopped it too."""


class LoopHealth:
    """Judges by its healthy cycles whether the loop runs; `look` is to be called often.

    Args:
        shared: The memory shared with the loop, made for this run.
        now_ns: The present instant.
    """

    def __init__(self, shared: SharedMap, now_ns: int) -> None:
        self._words, period_ns = shared.words, shared.layout.period_ns
        self._fresh_ns = 2 * period_ns
        self._hung_ns = max(int(HUNG_S * NS_PER_S), HUNG_PERIODS * period_ns)
        self._cycles = 0
        self._advanced_ns = self._looked_ns = now_ns

    def look(self, now_ns: int) -> bool:
        """Tell whether there were healthy cycles since the last look, or in the last two periods.

        The periods count for slow loops, of which not every look can find a new cycle.
        """
        pause_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        if pause_ns > BLINK_NS:
            self._advanced_ns += pause_ns
        cycles = self._words[Word.HEALTHY_CYCLES]
        if cycles == self._cycles:
            return self.started and now_ns - self._advanced_ns <= self._fresh_ns
        self._cycles, self._advanced_ns = cycles, now_ns
        return True

    @property
    def started(self) -> bool:
        """Whether there was a healthy cycle at all; before the first it may take its time."""
        return self._cycles > 0

    def hung(self, now_ns: int) -> bool:
        """Tell whether a loop that ran has had no healthy cycle for too long."""
        return self.started and now_ns - self._advanced_ns > self._hung_ns

    def age_s(self, now_ns: int) -> float:
        """Tell how long ago a look found healthy cycles, in s."""
        return (now_ns - self._advanced_ns) / NS_PER_S
