"""Whether a stage oscillates by itself: its error alternates while the command hardly moves."""

from typing import Final

from piezod.control.signals.recent_range import RecentRange
from piezod.units import NS_PER_S

LEAST_AMPLITUDE: Final = 0.01
"""An error counts from this part of the range on,"""
NOISE_SIGMAS: Final = 5.0
"""and from so many standard deviations of the noise on."""
PART_NS: Final = NS_PER_S // 10
PART_CYCLES: Final = 20
"""The time is cut into parts, the longer of the two."""
PARTS, ALTERNATIONS = 5, 2
"""A stage oscillates when the error alternates so often in each of so many parts in a row: what
rings after a step has faded by then."""


class Oscillation:
    """Watches one axis; fixed memory.

    Args:
        period_ns: Period of the loop.
    """

    def __init__(self, period_ns: int) -> None:
        self._part_cycles = max(PART_NS // period_ns, PART_CYCLES)
        self._command = RecentRange(self._part_cycles)
        self._cycles = self._alternations = self._parts = 0
        self._side = 0.0
        self.amplitude, self.limit = 0.0, LEAST_AMPLITUDE
        """Largest error in the last part, and what is compared with; in units of the range."""
        self._largest = 0.0

    @property
    def found(self) -> bool:
        """Whether the stage oscillates."""
        return self._parts >= PARTS

    def forget(self) -> None:
        """Begin anew; may be called in the loop."""
        self._cycles = self._alternations = self._parts = 0
        self._side = self._largest = 0.0
        self._command.forget()

    def update(self, command: float, position: float, noise: float) -> None:
        """Take a cycle; in units of the range, finite. May be called in the loop.

        Args:
            command: Displacement asked for.
            position: Measured displacement.
            noise: Standard deviation of its noise.
        """
        error = command - position
        self._command.add(command)
        limit = max(LEAST_AMPLITUDE, NOISE_SIGMAS * noise)
        if abs(error) > limit:
            self._alternations += error * self._side < 0.0
            self._side = error
        self._largest = max(self._largest, abs(error))
        self._cycles += 1
        if self._cycles == self._part_cycles:
            alternates = self._alternations >= ALTERNATIONS and self._command.swing < limit
            self._parts = min(self._parts + 1, PARTS) if alternates else 0
            self.amplitude, self.limit = self._largest, limit
            self._cycles = self._alternations = 0
            self._largest = 0.0
