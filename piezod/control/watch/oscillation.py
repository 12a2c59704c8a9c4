"""Detects that one axis oscillates, at rest and in motion: the watch of daemon and experiments.

An oscillation is an error that turns to and fro by more than noise explains, again and again. While
the command moves, three things make such errors without any oscillation: a lag turns the error
whenever the command turns, hysteresis adds harmonics of that, and a corner of the command rings a
mode for a while. So more turns and larger ones are needed then.
"""

from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.signals import RecentRange
from piezod.units import NS_PER_S

LEAST_AMPLITUDE: Final = 0.01
"""Errors up to this share of the range never count as oscillation."""
NOISE_SIGMAS: Final = 5.0
"""Errors up to this many standard deviations of the sensor noise do not count either."""
MOTION_SHARE: Final = 0.25
"""A turn to and fro counts only beyond this share of the motion of the command in a segment."""
CORNER_FACTOR, CORNER_SEGMENTS = 20.0, 3
"""It counts only beyond this multiple of the sharpest corner, the largest second difference of the
command, for this many segments: a corner rings a mode by 1/(ω T) of it to either side."""
TURNS_PER_TURN: Final = 3
"""The error of a stage that follows turns at most this often for each turn of the command."""
SEGMENT_NS: Final = NS_PER_S // 10
SEGMENT_CYCLES: Final = 20
"""The time is divided into segments of 0.1 s or 20 cycles, whichever is longer."""
SEGMENTS, ALTERNATIONS = 5, 2
"""A stage oscillates if the error turns at least this often in each of this many segments in a row.
The ringing after a step fades before that."""


class _Turns:
    """Counts how often a value turns by more than a threshold."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Start again."""
        self.count = 0
        self._rises = False
        self._farthest: float | None = None

    def add(self, value: float, threshold: float) -> None:
        """Take the value of this cycle."""
        farthest = self._farthest
        if farthest is None or (value > farthest) == self._rises:
            self._farthest = value
        elif abs(value - farthest) > threshold:
            self._farthest, self._rises = value, not self._rises
            self.count += 1


class Oscillation:
    """Detects that one axis oscillates around its command. Fixed memory. Real-time safe."""

    def __init__(self, period_ns: int) -> None:
        self._segment_cycles = max(SEGMENT_NS // period_ns, SEGMENT_CYCLES)
        self._error_turns, self._command_turns = _Turns(), _Turns()
        self._motion = RecentRange(self._segment_cycles)
        self._corner = RecentRange(CORNER_SEGMENTS * self._segment_cycles)
        self.amplitude, self.limit = 0.0, LEAST_AMPLITUDE
        """Half the swing of the error in the last segment, and the limit for it; in units of the
        range."""
        self.forget()

    @property
    def found(self) -> bool:
        """Whether the stage oscillates."""
        return self._segments >= SEGMENTS

    def forget(self) -> None:
        """Start again without any history."""
        self._cycles = self._segments = 0
        self._low = self._high = 0.0
        self._before: tuple[float, float] | None = None
        for each in (self._error_turns, self._command_turns, self._motion, self._corner):
            each.forget()

    def update(self, command: float, position: float, noise: float) -> None:
        """Take one cycle; all arguments are finite and in units of the range.

        Args:
            command: Command.
            position: Measured position.
            noise: Standard deviation of the noise of the position.
        """
        error, (last, step) = command - position, self._before or (command, 0.0)
        self._corner.add(abs(command - last - step))
        self._before = command, command - last
        self._motion.add(command)
        limit = max(LEAST_AMPLITUDE, NOISE_SIGMAS * noise)
        of_command = max(MOTION_SHARE * self._motion.swing, CORNER_FACTOR * self._corner.high)
        self._error_turns.add(error, max(2.0 * limit, of_command))
        self._command_turns.add(command, limit)
        if self._cycles == 0:
            self._low = self._high = error
        self._low, self._high = min(self._low, error), max(self._high, error)
        self._cycles += 1
        if self._cycles == self._segment_cycles:
            needed = ALTERNATIONS + TURNS_PER_TURN * self._command_turns.count
            alternates = self._error_turns.count >= needed
            self._segments = min(self._segments + 1, SEGMENTS) if alternates else 0
            self.amplitude, self.limit = 0.5 * (self._high - self._low), limit
            self._cycles = self._error_turns.count = self._command_turns.count = 0

    def detection(self, axis: int, width_um: float) -> Detection:
        """Return the fault of an axis that oscillates; the range of its positions is in µm."""
        return Detection(Fault.D6, axis, self.amplitude * width_um, self.limit * width_um)
