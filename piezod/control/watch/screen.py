"""Decides which samples may be used, and detects S2 to S8, S11 and S12.

A bad sample is dropped in its own cycle. It becomes a fault later, if several come in a row or if a
bucket trips.

A jump is a change of position that neither noise nor drive can explain. The part that the drive can
explain is estimated generously: a multiple of the drive's motion during the response time, which
decays as slowly as the stage rings. The noise is learned only while the command hardly bends, so
that no motion is mistaken for noise.
"""

from collections.abc import Sequence
from math import exp, nan, sqrt
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.signals import RANGE_MARGIN, LeakyBucket, NoiseLevel
from piezod.devices.interface import Sample
from piezod.devices.status import DeviceFlag, Flags
from piezod.hysteresis.normalisation import AffineRange
from piezod.units import NS_PER_S

IN_A_ROW: Final = 3
"""This many samples in a row that are out of range, saturated or without light are a fault."""
LATE_PERIODS, LATE_CYCLES = 1.5, 20
"""Samples older than this many periods, in this many cycles in a row, are a fault."""
TOO_LATE_PERIODS: Final = 3
"""An older sample, in periods, may not be used. A longer time without a usable sample is a
fault."""

_NOTHING: Final[Sequence[Detection]] = ()


class SampleScreen:
    """Screens the samples of one sensor. Fixed memory. Real-time safe.

    Args:
        axis: Index of the axis, for the detections.
        position_um: Range of the displacement, in µm.
        latency_ns: Smallest age of a sample of this sensor, in ns.
        period_ns: Period of the loop, in ns.
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
        self._nan_bucket, self._order_bucket = LeakyBucket(), LeakyBucket()
        self._counting = self._tripped = False
        self.usable = False
        """Whether the last sample may be used."""

    def check(
        self, t_ns: int, sample: Sample, flags: Flags, *, driven: bool
    ) -> Sequence[Detection]:
        """Return the faults of this sample and of those before it. Call once per cycle.

        If the stage is not driven, the sensor may not be zeroed yet, and any position is allowed.
        """
        cause = self._find_cause(t_ns, sample, flags)
        if cause is None and not self._counting:  # most cycles
            self.usable, self._usable_ns = True, t_ns
            return _NOTHING
        if cause is Fault.S3 and not driven:
            cause = None
        late = cause is Fault.S6
        self.usable = not cause or (late and t_ns - sample.t_ns <= self._too_late_ns)
        # Before the first usable sample the gap counts from the first cycle.
        if self.usable or self._usable_ns is None:
            self._usable_ns = t_ns
        if not (cause or self._counting):
            return _NOTHING
        self._count_cause(cause)
        return self._faults(t_ns, sample)

    def _find_cause(self, t_ns: int, sample: Sample, flags: Flags) -> Fault | None:
        """Return the fault that this sample alone would be; None if it is good."""
        taken_ns, position_um, valid = sample
        # The order of the checks is the order of trust: flags, validity, number, time, range, age.
        if flags and (flagged := _flagged(flags)):
            return flagged
        if not valid:
            return Fault.S5
        if position_um - position_um != 0.0:  # infinity or NaN; its time stamp does not count
            return Fault.S2
        newest_ns = self._newest_ns
        if taken_ns > t_ns or (newest_ns is not None and taken_ns <= newest_ns):
            return Fault.S11
        self._newest_ns = taken_ns
        if self._low_um <= position_um <= self._high_um:
            return Fault.S6 if t_ns - taken_ns > self._late_ns else None
        return Fault.S3

    def _count_cause(self, cause: Fault | None) -> None:
        """Count equal causes in a row, samples that are missing, and errors in the buckets."""
        # Only equal causes in a row make one fault; another cause restarts the count.
        self._in_a_row = self._in_a_row + 1 if cause and cause == self._cause else 1
        self._cause = cause
        self._missing = 0 if self.usable else self._missing + 1
        self._tripped = self._nan_bucket.update(cause is Fault.S2)
        self._tripped |= self._order_bucket.update(cause is Fault.S11)
        self._counting = bool(cause or self._nan_bucket.level or self._order_bucket.level)

    def _faults(self, t_ns: int, sample: Sample) -> Sequence[Detection]:
        """Return the fault that has lasted long enough, the most specific one first."""
        cause, repeated = self._cause, self._in_a_row >= IN_A_ROW
        none_left = self._missing > TOO_LATE_PERIODS
        found: Sequence[Detection] = _NOTHING
        if cause is Fault.S2 and (self._tripped or none_left):
            found = (Detection(Fault.S2, self._axis),)
        elif cause is Fault.S11 and (self._tripped or none_left):
            found = (self._in_seconds(Fault.S11, sample.t_ns - (self._newest_ns or 0), 0),)
        elif cause is Fault.S3 and repeated:
            low = sample.position_um < self._low_um
            limit_um = self._low_um if low else self._high_um
            found = (Detection(Fault.S3, self._axis, sample.position_um, limit_um),)
        elif cause in (Fault.S7, Fault.S8) and repeated:
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
    """Return the fault that the flags of a sensor mean; None without one."""
    if DeviceFlag.LOW_LIGHT in flags:
        return Fault.S8
    return Fault.S7 if DeviceFlag.SATURATED in flags else None


JUMP_SIGMAS: Final = 8.0
"""A jump exceeds the sum of three terms. First, this many standard deviations of the noise of both
positions."""
LEAST_JUMP: Final = 0.005
"""Second, this share of the range."""
REACH_PER_SWING: Final = 3.0
"""Third, this multiple of the drive's motion, both in units of their range: no stage reacts more
strongly."""
SPIKE_SAMPLES: Final = 2
"""This many samples in a row are dropped as spikes; the next one is the new position."""
STEADY_SIGMAS: Final = 0.5
"""The noise is learned while the second difference of the reference moves the second difference of
the position by less than this many standard deviations."""
LEARNED_CYCLES: Final = 5000
"""The usual noise is unknown before this many cycles of learning."""
EXCESS_FACTOR: Final = 5.0
"""The noise is a fault if its amplitude exceeds the usual one by this factor."""


class JumpWatch:
    """Detects jumps of one position signal and learns its noise. Fixed memory. Real-time safe.

    Args:
        ringing_ns: Decay time of the ringing of the stage, to a third, in ns.
        period_ns: Period of the loop, in ns.
    """

    def __init__(self, ringing_ns: int, period_ns: int) -> None:
        self._decay = exp(-period_ns / ringing_ns)
        self._reach = self._bend = 0.0
        self._reference_before, self._reference = nan, nan
        self._steady, self._learned_cycles = False, 0
        self._last_position, self._spikes = nan, 0
        self._noise = NoiseLevel()
        self.noise = sqrt(self._noise.variance)
        """Standard deviation of the noise, in units of the range."""
        self.jump, self.allowed = 0.0, 0.0
        """Distance between the last two positions, and the largest distance that is no jump."""

    @property
    def excess(self) -> float:
        """Amplitude of the noise over the usual one; 1 until the usual one is known."""
        if self._learned_cycles < LEARNED_CYCLES:
            return 1.0
        return sqrt(self._noise.excess)

    def move(self, reference: float, swing: float) -> None:
        """Take the motion of this cycle. Call once per cycle.

        Args:
            reference: Position that the stage should follow, in units of its range. That is the
                command if there is one, because the drive contains the sensor noise; otherwise the
                drive.
            swing: Motion of the drive during the response time, in units of its range.
        """
        bend = REACH_PER_SWING * abs(reference - 2.0 * self._reference + self._reference_before)
        self._reference_before, self._reference = self._reference, reference
        reach, faded = REACH_PER_SWING * swing, self._reach * self._decay
        self._reach = faded if faded > reach else reach
        faded = self._bend * self._decay
        self._bend = bend if bend > faded else faded  # the old value if `bend` is NaN

    def update(self, position: float) -> int:
        """Take a position, in units of the range.

        Returns:
            Number of spikes in a row, this one included. `SPIKE_SAMPLES` plus one is a jump to a
            new position; 0 means that the position is good.
        """
        self._learn(position)
        self.jump = abs(position - self._last_position)
        self.allowed = LEAST_JUMP + self._reach + JUMP_SIGMAS * sqrt(2.0 * self._noise.variance)
        if not self.jump > self.allowed:
            self._last_position, self._spikes = position, 0
            return 0
        self._spikes += 1
        count = self._spikes
        if count > SPIKE_SAMPLES:
            self._last_position, self._spikes = position, 0
        return count

    def missed(self) -> None:
        """Note that this cycle has no usable position."""
        self._last_position, self._spikes = nan, 0

    def zeroed(self) -> None:
        """Note that the positions count from another zero: the next one is no jump, nor noise."""
        self.missed()
        self._noise.update(nan)

    def _learn(self, position: float) -> None:
        """Learn the noise from this position if the stage does not accelerate."""
        noise = self._noise
        before, self._steady = self._steady, self._bend < STEADY_SIGMAS * self.noise
        if not self._steady:
            return
        if not before:
            # NaN clears the two samples that the second difference needs.
            noise.update(nan)  # the sample before the motion is no neighbour
        noise.update(position)
        self.noise = sqrt(noise.variance)
        if self._learned_cycles < LEARNED_CYCLES:
            self._learned_cycles += 1
