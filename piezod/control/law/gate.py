"""Whether a sample may teach the identifier: only one that says something true about the stage."""

from enum import StrEnum
from math import isfinite
from typing import Final

from piezod.control.signals.noise import NoiseLevel
from piezod.control.signals.sliding_range import SlidingRange
from piezod.control.signals.stuck import StuckSensor
from piezod.units import NS_PER_S

WINDOW_S: Final = 1.0
LEAST_SWING: Final = 0.02
"""Excitation: the drive must swing by this share of its range within the window."""
LIMITED_CYCLES: Final = 5
"""After the drive was limited the gate stays closed this long: samples come late, and the stage
still answers to what was cut off."""
SPIKE_CYCLES: Final = 20
"""After a spike the gate stays closed this long: noise that has become larger begins with spikes,
one in two samples, and until then is known to be noise."""
STUCK_SWING: Final = 0.01
"""A sensor is stuck when its samples stay the same while the drive moves by more than this share of
its range."""


class GateReason(StrEnum):
    """Whether the identifier learns, and if not, why not: the first that applies."""

    OPEN = "learning"
    INVALID = "sample invalid"
    LATE = "sample late"
    SKIPPED = "periods skipped"
    LIMITED = "drive limited"
    STUCK = "sensor stuck"
    SPIKE = "spike"
    NOISY = "sensor noisier than usual"
    QUIET = "no excitation"
    REPEATED = "sample repeated"


class LearningGate:
    """Decides for one axis, cycle by cycle; deterministic, fixed memory.

    Args:
        period_ns: Period of the loop.
        latency_ns: How old a sample of this sensor is at best; it is late a period after that.
    """

    def __init__(self, period_ns: int, latency_ns: int = 0) -> None:
        self._late_ns = latency_ns + period_ns
        self._drive_swing = SlidingRange(round(WINDOW_S * NS_PER_S / period_ns))
        self._limited_cycles = self._spike_cycles = 0
        self.skipped = False
        """Whether periods were skipped just before this cycle: the stage moved meanwhile."""
        self._stuck = StuckSensor(STUCK_SWING)
        self._noise = NoiseLevel()
        self.reason = GateReason.QUIET
        """Verdict on the last sample."""
        self.credible = False
        """Whether it says something true about the stage: valid, not late, not stuck, no spike."""
        self.accurate = False
        """Whether it is credible and its noise what it usually is: an operator may remember it."""
        self.counts = dict.fromkeys(GateReason, 0)
        """Cycles with each verdict."""

    def admits(
        self, *, valid: bool, age_ns: int, limited: bool, drive: float, position: float
    ) -> bool:
        """Return whether this cycle's sample may teach; call it once in each cycle, in the loop.

        Args:
            valid: Whether the device calls the sample valid.
            age_ns: How long before this cycle the sample was taken.
            limited: Whether range or slew rate cut off part of the drive that is in force.
            drive: Drive in force, normalised, finite.
            position: Measured displacement, normalised.
        """
        self.reason = self._verdict(valid, age_ns, limited, drive, position)
        self.counts[self.reason] += 1
        return self.reason is GateReason.OPEN

    def _verdict(
        self, valid: bool, age_ns: int, limited: bool, drive: float, position: float
    ) -> GateReason:
        # Whatever the verdict, all that is followed over several cycles goes on.
        quiet = self._drive_swing.add(drive) < LEAST_SWING
        self._limited_cycles = LIMITED_CYCLES + 1 if limited else max(self._limited_cycles - 1, 0)
        self.credible = self.accurate = False
        if not (valid and isfinite(position)):
            return GateReason.INVALID
        if age_ns > self._late_ns:
            return GateReason.LATE
        stuck = self._stuck.update(position, drive)
        spike = not stuck and self._noise.update(position)  # a stuck sensor has no noise to learn
        self._spike_cycles = SPIKE_CYCLES if spike else max(self._spike_cycles - 1, 0)
        self.credible = not (stuck or spike)
        self.accurate = not (stuck or self._spike_cycles or self._noise.unusual)
        if self.skipped or self._limited_cycles:
            return GateReason.SKIPPED if self.skipped else GateReason.LIMITED
        if not self.accurate:
            return self._inaccuracy(stuck)
        if quiet:
            return GateReason.QUIET
        return GateReason.REPEATED if self._stuck.repeated else GateReason.OPEN

    def _inaccuracy(self, stuck: bool) -> GateReason:
        if stuck:
            return GateReason.STUCK
        return GateReason.SPIKE if self._spike_cycles else GateReason.NOISY
