"""Watches the adaptation of one axis, and the loop that the adaptation closes.

Detects D1, D2, D5, D6 and D11. D3 (weights without an inverse) cannot occur, because the
identifiers prevent it. D4 and D7 (samples that must not be learned from) are left out and counted
by the learning gate.

An oscillation is an error that turns to and fro by more than noise explains, again and again. While
the command moves, three things make such errors without any oscillation: a lag turns the error
whenever the command turns, hysteresis adds harmonics of that, and a corner of the command rings a
mode for a while. So more turns and larger ones are needed then. Experiments in virtual time use the
same detection.
"""

from collections.abc import Sequence
from math import inf
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.law.learned_models import LearnedBound, ModelProof, is_finite
from piezod.control.signals import RecentRange
from piezod.hysteresis.adaptation import AdaptiveIdentifier
from piezod.hysteresis.normalisation import AffineRange
from piezod.hysteresis.online import Shadowed
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
        if error < self._low:
            self._low = error
        elif error > self._high:
            self._high = error
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


RESTORATIONS: Final = 3
RESTORATION_WINDOW_NS: Final = 30 * NS_PER_S
"""This many returns to the last good model within this time are more than a passing disturbance."""
TOLD_SHARE, AT_BOUND = 0.5, 0.7
"""Shares of its bound from which the mean distance of the learned model is D11, and D5. At the
bound the model moves to and fro with the motion, so that the mean distance is less."""
FINITE_INTERVAL_NS: Final = NS_PER_S // 10
"""Interval between two looks at the learned numbers for one that is NaN or infinite."""

_NOTHING: Final[Sequence[Detection]] = ()


class AdaptationWatch:
    """Watches the adaptation of one axis. Fixed memory. Real-time safe.

    Args:
        axis: Index of the axis, for the detections.
        adaptation: The learning algorithm, `identifier.adaptation`.
        proof: Compares the learned model with the identified one, while it is in use.
        bound: Keeps the learned model near the identified one; None if there is no such model.
        position_um: Range of the displacement, in µm.
        period_ns: Period of the loop, in ns.
    """

    def __init__(
        self,
        axis: int,
        adaptation: AdaptiveIdentifier,
        proof: ModelProof,
        bound: LearnedBound | None,
        position_um: AffineRange,
        period_ns: int,
    ) -> None:
        self._axis = axis
        self._low_um, self._width_um = position_um.low, position_um.width
        self._adaptation, self._proof = adaptation, proof
        self._shadowed = adaptation if isinstance(adaptation, Shadowed) else None
        self._restored, self._restored_cycles = 0, [-inf] * RESTORATIONS
        self._cycles = 0
        self._restoration_window_cycles = max(RESTORATION_WINDOW_NS // period_ns, 1)
        self._bound = bound
        self._finite_interval_cycles = max(FINITE_INTERVAL_NS // period_ns, 1)
        self._not_finite = False
        self._oscillation = Oscillation(period_ns)

    def check(
        self, command_um: float, position_um: float, *, closed: bool, noise_um: float
    ) -> Sequence[Detection]:
        """Return the faults of the adaptation in this cycle. Call once per cycle.

        Args:
            command_um: Command, in µm; NaN if there is none.
            position_um: Measured position, in µm; NaN if the sample may not be used.
            closed: Whether the sample acts on the drive: a mode that needs the sensor, in RUN.
            noise_um: Standard deviation of the sensor noise, in µm.
        """
        self._cycles += 1
        if self._cycles % self._finite_interval_cycles == 0:
            self._not_finite = not is_finite(self._adaptation)
        drifts = self._drifts()
        restored, worse = self._restored_too_often(), self._proof.take_verdict()
        if not closed and not self._not_finite:
            self._oscillation.forget()
            return drifts
        if not closed:
            self._oscillation.forget()
            # In an open loop the learned model does not act on the drive. It is saved and shown.
            return (Detection(Fault.D2, self._axis), *drifts)
        both_um = command_um - position_um
        if both_um - both_um == 0.0:  # both are finite
            low_um, width_um = self._low_um, self._width_um
            self._oscillation.update(
                (command_um - low_um) / width_um,
                (position_um - low_um) / width_um,
                noise_um / width_um,
            )
        if not (restored or worse or self._not_finite or self._oscillation.found):
            return drifts
        return (*self._detections(restored, worse), *drifts)

    def _restored_too_often(self) -> bool:
        """Return whether the last good model was restored too often within the time limit."""
        if self._shadowed is None or self._shadowed.restored == self._restored:
            return False
        self._restored = self._shadowed.restored
        # The cycles of the last returns, oldest first.
        self._restored_cycles = [*self._restored_cycles[1:], self._cycles]
        return self._cycles - self._restored_cycles[0] <= self._restoration_window_cycles

    def _drifts(self) -> Sequence[Detection]:
        """Return D11 if the learned model is far from the identified one, D5 at its bound."""
        bound = self._bound
        if bound is None or bound.distance < TOLD_SHARE * bound.limit:
            return _NOTHING
        at_bound = bound.distance >= AT_BOUND * bound.limit
        fault, share = (Fault.D5, AT_BOUND) if at_bound else (Fault.D11, TOLD_SHARE)
        return (Detection(fault, self._axis, bound.distance, share * bound.limit),)

    def _detections(self, restored: bool, worse: tuple[float, float] | None) -> Sequence[Detection]:
        """Return the detections of a loop that is closed."""
        found, width_um = [], self._width_um
        if self._not_finite:
            found.append(Detection(Fault.D2, self._axis))
        if worse:
            measured_um, limit_um = (share * width_um for share in worse)
            found.append(Detection(Fault.D1, self._axis, measured_um, limit_um))
        elif restored:
            found.append(Detection(Fault.D1, self._axis, RESTORATIONS, RESTORATIONS - 1))
        if self._oscillation.found:
            found.append(self._oscillation.detection(self._axis, width_um))
        return found
