"""Displacements that jump by more than noise and drive can explain, and noise that grows: S4, S12.

What the drive can explain is taken wide: a few times what it moved by while the stage answered, and
fading from there as fast as the stage stops ringing. The noise is learned where what is asked for
hardly bends, or has not for a while, so that no motion is taken for noise.
"""

from math import exp, nan, sqrt
from typing import Final

from piezod.control.signals.noise import NoiseLevel

JUMP_SIGMAS: Final = 8.0
"""A jump exceeds the noise of both displacements by so many standard deviations,"""
LEAST_JUMP: Final = 0.005
"""and this part of the range,"""
PER_SWING: Final = 3.0
"""and so many times what the drive moved by: no stage answers that strongly."""
SPIKE_SAMPLES: Final = 2
"""So many samples in a row are left out as spikes; what comes then is where the stage is."""
STEADY_SIGMAS: Final = 0.5
"""The noise is learned while what the wish's second difference can do to that of the displacement
is less than so many standard deviations of it."""
LEARNED_CYCLES: Final = 5000
"""Before that it is not known what noise is usual."""
EXCESS: Final = 5.0
"""So many times its usual amplitude, noise is in excess."""


class JumpWatch:
    """Watches one axis; fixed memory.

    Args:
        ringing_ns: How fast the stage stops ringing: to a third in this time.
        period_ns: Period of the loop.
    """

    def __init__(self, ringing_ns: int, period_ns: int) -> None:
        self._fade = exp(-period_ns / ringing_ns)
        self._reach = self._bend = 0.0
        self._wish_before, self._wish = nan, nan
        self._steady, self._learned_cycles = False, 0
        self._last, self._spikes = nan, 0
        self._noise = NoiseLevel()
        self.jump, self.allowed = 0.0, 0.0
        """How far the last displacement was from the one before, and how far is no jump."""

    @property
    def noise(self) -> float:
        """Standard deviation of the noise, in units of the range."""
        return sqrt(self._noise.variance)

    @property
    def excess(self) -> float:
        """How many times its usual amplitude the noise has; 1 until that is known."""
        return sqrt(self._noise.excess) if self._learned_cycles >= LEARNED_CYCLES else 1.0

    def move(self, wish: float, swing: float) -> None:
        """Take what moves the stage; may be called in the loop, once in each cycle.

        Args:
            wish: Where it is asked to be: the command where there is one, as the drive has the
                sensor's own noise in it; else the drive; in units of its range.
            swing: By how much the drive moved while the stage answered, likewise.
        """
        bend = abs(wish - 2.0 * self._wish + self._wish_before)
        self._wish_before, self._wish = self._wish, wish
        self._reach = max(PER_SWING * swing, self._reach * self._fade)
        self._bend *= self._fade
        self._bend = max(self._bend, PER_SWING * bend)  # in this order: it may not be a number yet

    def update(self, position: float) -> int:
        """Take a displacement, in units of the range; may be called in the loop.

        Returns:
            The spikes in a row that this is the last of; one more than `SPIKE_SAMPLES` where it is
            a jump to stay; 0 where all is well.
        """
        self._learn(position)
        self.jump = abs(position - self._last)
        self.allowed = LEAST_JUMP + self._reach + JUMP_SIGMAS * sqrt(2.0 * self._noise.variance)
        if not self.jump > self.allowed:
            self._last, self._spikes = position, 0
            return 0
        self._spikes += 1
        count = self._spikes
        if count > SPIKE_SAMPLES:
            self._last, self._spikes = position, 0
        return count

    def missed(self) -> None:
        """Learn that there is no displacement in this cycle; may be called in the loop."""
        self._last, self._spikes = nan, 0

    def _learn(self, position: float) -> None:
        noise = self._noise
        before, self._steady = self._steady, self._bend < STEADY_SIGMAS * sqrt(noise.variance)
        if not self._steady:
            return
        if not before:
            noise.update(nan)  # what was before the motion is no neighbour
        noise.update(position)
        self._learned_cycles = min(self._learned_cycles + 1, LEARNED_CYCLES)
