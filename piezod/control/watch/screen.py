"""Which samples may be used: S2 to S8, S11 and S12.

A sample that may not be used is left out in its own cycle. That it is a fault is said later, when a
few came in a row or a bucket has tripped. A displacement jumps if it moved by more than noise and
drive can explain. What the drive can explain is taken wide: a few times what it moved by while the
stage answered, and fading from there as fast as the stage stops ringing. The noise is learned where
what is asked for hardly bends, or has not for a while, so that no motion is taken for noise.
"""

from collections.abc import Sequence
from math import exp, nan, sqrt
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.control.signals import LeakyBucket, NoiseLevel
from piezod.devices.interface import Sample
from piezod.devices.status import DeviceFlag, Flags
from piezod.hysteresis.normalisation import AffineRange
from piezod.units import NS_PER_S

RANGE_MARGIN: Final = 0.2
"""A displacement so far outside its range, in parts of it, is not physical."""
IN_A_ROW: Final = 3
"""So many samples in a row out of range, saturated or without light are a fault."""
LATE_PERIODS: Final = 1.5
LATE_CYCLES: Final = 20
"""Samples that are older than this for so many cycles are a fault."""
TOO_LATE_PERIODS: Final = 3
"""A sample older than this may not be used; so long without one is a fault."""

_NOTHING: Final[Sequence[Detection]] = ()


class SampleScreen:
    """Screens the samples of one sensor; fixed memory.

    Args:
        axis: Index of the axis, for the detections.
        position_um: Range of the displacement.
        latency_ns: How old a sample of this sensor is at best.
        period_ns: Period of the loop.
    """

    def __init__(
        self, axis: int, position_um: AffineRange, latency_ns: int, period_ns: int
    ) -> None:
        margin_um = RANGE_MARGIN * position_um.width
        self._axis = axis
        self._low_um, self._high_um = position_um.low - margin_um, position_um.high + margin_um
        self._late_ns = latency_ns + round(LATE_PERIODS * period_ns)
        self._too_late_ns = latency_ns + TOO_LATE_PERIODS * period_ns
        self._newest_ns: int | None = None
        self._usable_ns: int | None = None
        self._cause: Fault | None = None
        self._in_a_row = self._missing = 0
        self._not_numbers, self._disordered = LeakyBucket(), LeakyBucket()
        self._troubled = self._tripped = False
        self.usable = False
        """Whether the last sample may be used."""

    def check(
        self, t_ns: int, sample: Sample, flags: Flags, *, driven: bool
    ) -> Sequence[Detection]:
        """Return what is wrong with a sample, or with those before it; call it in the loop.

        A stage that is not driven may not even be zeroed yet: its samples may be anywhere.
        """
        cause = self._find_cause(t_ns, sample, flags)
        if cause is Fault.S3 and not driven:
            cause = None
        late = cause is Fault.S6
        self.usable = not cause or (late and t_ns - sample.t_ns <= self._too_late_ns)
        if self.usable or self._usable_ns is None:
            self._usable_ns = t_ns
        if not (cause or self._troubled):
            return _NOTHING
        self._count(cause)
        return self._judge(t_ns, sample)

    def _find_cause(self, t_ns: int, sample: Sample, flags: Flags) -> Fault | None:
        taken_ns, position_um, valid = sample
        if flags and (flagged := _flagged(flags)):
            return flagged
        if not valid:
            return Fault.S5
        if position_um - position_um != 0.0:  # infinite or not a number: time stands still for it
            return Fault.S2
        newest_ns = self._newest_ns
        if taken_ns > t_ns or (newest_ns is not None and taken_ns <= newest_ns):
            return Fault.S11
        self._newest_ns = taken_ns
        if self._low_um <= position_um <= self._high_um:
            return Fault.S6 if t_ns - taken_ns > self._late_ns else None
        return Fault.S3

    def _count(self, cause: Fault | None) -> None:
        self._in_a_row = self._in_a_row + 1 if cause and cause == self._cause else 1
        self._cause = cause
        self._missing = 0 if self.usable else self._missing + 1
        self._tripped = self._not_numbers.update(cause is Fault.S2)
        self._tripped |= self._disordered.update(cause is Fault.S11)
        self._troubled = bool(cause or self._not_numbers.level or self._disordered.level)

    def _judge(self, t_ns: int, sample: Sample) -> Sequence[Detection]:
        cause, many = self._cause, self._in_a_row >= IN_A_ROW
        none_left = self._missing > TOO_LATE_PERIODS
        found: Sequence[Detection] = _NOTHING
        if cause is Fault.S2 and (self._tripped or none_left):
            found = (Detection(Fault.S2, self._axis),)
        elif cause is Fault.S11 and (self._tripped or none_left):
            found = (self._in_seconds(Fault.S11, sample.t_ns - (self._newest_ns or 0), 0),)
        elif cause is Fault.S3 and many:
            low = sample.position_um < self._low_um
            limit_um = self._low_um if low else self._high_um
            found = (Detection(Fault.S3, self._axis, sample.position_um, limit_um),)
        elif cause in (Fault.S7, Fault.S8) and many:
            found = (Detection(cause, self._axis),)
        elif none_left:
            since_ns = self._usable_ns or t_ns
            found = (self._in_seconds(Fault.S5, t_ns - since_ns, self._too_late_ns),)
        elif cause is Fault.S6 and self._in_a_row >= LATE_CYCLES:
            found = (self._in_seconds(Fault.S6, t_ns - sample.t_ns, self._late_ns),)
        return found

    def _in_seconds(self, fault: Fault, measured_ns: int, limit_ns: int) -> Detection:
        return Detection(fault, self._axis, measured_ns / NS_PER_S, limit_ns / NS_PER_S)


def _flagged(flags: Flags) -> Fault | None:
    if DeviceFlag.LOW_LIGHT in flags:
        return Fault.S8
    return Fault.S7 if DeviceFlag.SATURATED in flags else None


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
