"""Adaptation in the loop: pairs samples with voltages, and decides which samples may teach."""

from math import isfinite
from typing import Final

from piezod.config.gate_reasons import GateReason
from piezod.control.law.creep import AT_REST, CreepState
from piezod.control.signals import NoiseLevel, SlidingRange, StuckSensor
from piezod.devices.interface import Sample
from piezod.hysteresis.adaptation import AdaptiveIdentifier
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.lms import Convergence
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.normalisation import AffineRange
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


class DriveHistory:
    """A ring of the voltages that were in force, one entry per cycle; nothing grows.

    Between entries the voltage is interpolated linearly, as it is for recorded data: a delay that
    was identified from a record means the same here.

    Args:
        in_force_v: Voltage in force before the first entry, in V.
        entries: Cycles remembered; older times get the oldest voltage.
    """

    def __init__(self, in_force_v: float, entries: int) -> None:
        self._t_ns = [0] * entries
        self._drive_v = [in_force_v] * entries
        self._newest = 0
        self._empty = True

    def append(self, t_ns: int, drive_v: float) -> None:
        """Note the voltage in force at an instant, later than all before; call it in the loop."""
        if self._empty:
            self._t_ns = [t_ns] * len(self._t_ns)
            self._empty = False
        self._newest = (self._newest + 1) % len(self._t_ns)
        self._t_ns[self._newest] = t_ns
        self._drive_v[self._newest] = drive_v

    def at(self, t_ns: int) -> float:
        """Return the voltage that was in force at an instant, in V; may be called in the loop."""
        later = self._newest
        for back in range(len(self._t_ns)):
            index = self._newest - back
            if self._t_ns[index] <= t_ns:
                return self._between(index, later, t_ns)
            later = index
        return self._drive_v[later]

    def _between(self, earlier: int, later: int, t_ns: int) -> float:
        span_ns = self._t_ns[later] - self._t_ns[earlier]
        if span_ns <= 0:
            return self._drive_v[earlier]
        part = (t_ns - self._t_ns[earlier]) / span_ns
        return self._drive_v[earlier] + (self._drive_v[later] - self._drive_v[earlier]) * part


class Identifier:
    """Follows one axis; its weights are what the compensator adopts or follows.

    Args:
        adaptation: The algorithm, with the weights to start from.
        drive_v: Range of the drive that is [0, 1] for the model, in V.
        position_um: Range of the displacement that is [0, 1] for the model, in µm.
        history: Voltages in force, kept by the axis.
        delay_ns: How long the displacement lags behind the voltage.
        convergence: When the weights count as converged; None if a model is known already.
        gate: Which samples may teach.
        creep: How far the stage has crept, and where it is.
    """

    def __init__(
        self,
        adaptation: AdaptiveIdentifier,
        drive_v: AffineRange,
        position_um: AffineRange,
        history: DriveHistory,
        delay_ns: int,
        convergence: Convergence | None,
        gate: LearningGate,
        creep: CreepState = AT_REST,
    ) -> None:
        self.adaptation, self.gate = adaptation, gate
        self._drive_v, self._position_um = drive_v, position_um
        self._history, self._delay_ns = history, delay_ns
        self._convergence = convergence
        self._creep, self._zeroed = creep.creep, creep.zeroed
        self._lags, self._quick = creep.lags.copy(), creep.quick
        self.gain_halved = self._left_out = False
        """Whether only every second sample is learned from."""
        self.converged = False
        """Whether the weights have converged, over a window and up to the last sample."""

    @property
    def weights(self) -> FloatArray:
        """Weights [a^l, a^r], shape (2 M,); they change in place."""
        return self.adaptation.weights

    @property
    def offset(self) -> float:
        """Drift of the displacement, in units of the range; 0 where it is not identified."""
        return self.adaptation.offset

    @property
    def scale(self) -> float:
        """By how much more than the displacement the hysteresis sees; 0 if not identified."""
        return self.adaptation.scale

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory had to give up."""
        return self.adaptation.merged_pairs

    def zero(self) -> None:
        """Count from here on: the stage rests, and its sensor was zeroed; call it in the loop."""
        self._zeroed = float(self._creep.weights @ self._lags)

    def learn(self, t_ns: int, sample: Sample, *, limited: bool, expected: float) -> None:
        """Take the sample of this cycle; adapt if it can teach; may be called in the loop.

        Where the sample is not accurate the memory goes on with what the compensator expects:
        the stage moves all the same, and an extremum that was missed would be wrong for long.

        Args:
            t_ns: Instant of the cycle.
            sample: What was measured.
            limited: Whether range or slew rate cut off part of the drive that is in force.
            expected: Displacement that the compensator's memory has, normalised.
        """
        lags, gains, weights = self._lags, self._creep.gains, self._creep.weights
        crept = advance_creep(lags, gains, weights, self._quick)
        position = self._position_um.to_unit(sample.position_um)
        drive = self._drive_v.to_unit(self._history.at(sample.t_ns - self._delay_ns))
        may_teach = self.gate.admits(
            valid=sample.valid,
            age_ns=t_ns - sample.t_ns,
            limited=limited,
            drive=drive,
            position=position,
        )
        if self.gain_halved and may_teach:
            self._left_out = not self._left_out
            may_teach = not self._left_out
        # What creeps is what the hysteresis sees: so has crept in its units, not in the sensor's.
        seen = position + self._zeroed - crept / (1.0 + self.scale)
        if not self.gate.accurate:
            seen = (expected + self.offset) / (1.0 + self.scale)
        convergence = self._convergence
        before = self.adaptation.position if convergence else 0.0
        error = self.adaptation.step(seen, drive, may_teach)
        self._quick = (1.0 + self.scale) * seen - self.offset
        # At rest any weights predict well.
        if convergence and may_teach and self.adaptation.position != before:
            self.converged = convergence.update(error)
