"""Adaptation in the loop: which samples it learns from, how, and whether the result is better."""

from collections import deque
from collections.abc import Callable
from functools import partial
from math import nan
from typing import Final, NamedTuple

from piezod.config.gate_reasons import GateReason
from piezod.control.law.compensator import DriveHistory
from piezod.control.law.creep import AT_REST, CreepState
from piezod.control.law.dynamics import ModalMotion
from piezod.control.law.learned_models import ModelErrors
from piezod.control.signals import NoiseLevel, SlidingRange, StuckSensor, is_physical
from piezod.devices.interface import Sample
from piezod.hysteresis.adaptation import AdaptiveIdentifier, LearnedModel
from piezod.hysteresis.creep import advance_creep
from piezod.hysteresis.lms import Convergence
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.normalisation import AffineRange
from piezod.units import NS_PER_S

WINDOW_S, LEAST_SWING = 1.0, 0.02
"""Excitation: within this window the drive must swing by this share of its range."""
LIMITED_CYCLES: Final = 5
"""The gate stays closed for this many cycles after the drive was limited or periods were skipped:
samples come late, and the stage still reacts to the part that was cut off."""
SPIKE_CYCLES: Final = 20
"""The gate stays closed for this many cycles after a spike: growing noise first looks like them."""
STUCK_SWING: Final = 0.01
"""A sensor is stuck if its samples are equal while the drive moves by more than this share."""
BESIDE_SHARE: Final = 0.1
"""Share of each accurate sample in the mean distance of the stage from what the model expects."""
_OPEN: Final = GateReason.OPEN
_COMPARABLE: Final = frozenset({_OPEN, GateReason.QUIET, GateReason.REPEATED})


class LearningGate:
    """Decides in each cycle whether an axis may learn. Deterministic, fixed memory, real-time safe.

    Args:
        period_ns: Period of the loop, in ns.
        latency_ns: Smallest age of a sample, in ns; a sample is late if it is a period older.
    """

    def __init__(self, period_ns: int, latency_ns: int = 0) -> None:
        self._late_ns = latency_ns + period_ns
        self._drive_swing = SlidingRange(round(WINDOW_S * NS_PER_S / period_ns))
        self._limited_cycles = self._spike_cycles = self._skipped_cycles = 0
        self._stuck = StuckSensor(STUCK_SWING)
        self._noise = NoiseLevel()
        self.doubted = False
        """Whether a fault says that the samples may be wrong: nothing is learned."""
        self.reason = GateReason.QUIET
        """Decision on the last sample."""
        self.credible = False
        """Whether the last sample is credible: valid, not late, not stuck, no spike."""
        self.accurate = False
        """Whether the last sample is credible and has its usual noise: the operators may take
        it."""
        self.counts = dict.fromkeys(GateReason, 0)
        """Number of cycles with each decision."""

    @property
    def comparable(self) -> bool:
        """Whether the last sample shows how well the stage follows: usable, and no limit acts."""
        return self.reason in _COMPARABLE

    @property
    def noise_variance(self) -> float:
        """Variance of the noise of the samples, in units of the range squared."""
        return self._noise.variance

    @property
    def skipped(self) -> bool:
        """Whether periods were skipped shortly before this cycle."""
        return self._skipped_cycles > 0

    def skip(self) -> None:
        """Close the gate for some cycles, from the next sample on: periods were skipped."""
        self._skipped_cycles = LIMITED_CYCLES + 2  # each decision counts down first

    def admits(
        self, *, valid: bool, age_ns: int, limited: bool, drive: float, position: float
    ) -> bool:
        """Return whether the identifier may learn from this sample. Call once per cycle.

        Args:
            valid: Whether the device marks the sample as valid.
            age_ns: Age of the sample in this cycle, in ns.
            limited: Whether range or slew rate limited the drive in force.
            drive: Drive in force, normalised, finite.
            position: Measured position, normalised.
        """
        self.reason = self._decide(valid, age_ns, limited, drive, position)
        self.counts[self.reason] += 1
        return self.reason is _OPEN

    def _decide(
        self, valid: bool, age_ns: int, limited: bool, drive: float, position: float
    ) -> GateReason:
        """Return the first reason that applies."""
        # Whatever the decision, everything that spans several cycles must be updated first.
        quiet = self._drive_swing.add(drive) < LEAST_SWING
        if limited:
            self._limited_cycles = LIMITED_CYCLES + 1
        elif self._limited_cycles:
            self._limited_cycles -= 1
        if self._skipped_cycles:
            self._skipped_cycles -= 1
        self.credible = self.accurate = False
        if not (valid and position - position == 0.0):  # finite
            return GateReason.INVALID
        if age_ns > self._late_ns:
            return GateReason.LATE
        stuck = self._stuck.update(position, drive)
        spike = not stuck and self._noise.update(position)  # a stuck sensor has no noise
        if spike:
            self._spike_cycles = SPIKE_CYCLES
        elif self._spike_cycles:
            self._spike_cycles -= 1
        self.credible = not (stuck or spike)
        noisy = self._noise.unusual
        self.accurate = not (stuck or self._spike_cycles or noisy or self.doubted)
        if not self.accurate or self._skipped_cycles or self._limited_cycles:
            return self._obstacle(stuck, noisy)
        if quiet:
            return GateReason.QUIET
        # An equal sample may be the first of a stuck sensor, so it is not learned from.
        return GateReason.REPEATED if self._stuck.repeated else _OPEN

    def _obstacle(self, stuck: bool, noisy: bool) -> GateReason:
        """Return what forbids to learn from a sample that came in time."""
        if self.doubted:
            return GateReason.DOUBTED
        if self._skipped_cycles or self._limited_cycles:
            return GateReason.SKIPPED if self._skipped_cycles else GateReason.LIMITED
        if noisy and not (stuck or self._spike_cycles):
            return GateReason.NOISY
        return GateReason.STUCK if stuck else GateReason.SPIKE


class _Arrived(NamedTuple):
    """A sample, as it was when it arrived."""

    sample: Sample  #: The sample.
    admitted: bool  #: Whether the gate was open.
    accurate: bool  #: Whether it is accurate.
    comparable: bool  #: Whether it shows how well the stage follows its command.


class Identifier:
    """Learns the inverse model of one axis, paper section 2.3. All methods are real-time safe.

    With a negative delay a sample answers a voltage that is written after it has arrived. It then
    waits for that voltage: it is learned from some cycles later.

    Args:
        adaptation: The learning algorithm, with the weights to start from.
        drive_v: Range of the drive that is [0, 1] for the model, in V.
        position_um: Range of the displacement that is [0, 1] for the model, in µm.
        history: Voltages in force, appended by the axis.
        delay_ns: Delay of the displacement behind the voltage, in ns; either sign.
        period_ns: Period of the loop, in ns.
        convergence: Criterion of convergence; None if a model is known already.
        gate: Decides which samples the identifier learns from.
        creep: Creep so far, and the displacement.
        modal: Part of the displacement that the modes add; None if they are unknown.
        errors: Errors of the identified and of the learned model; None if nobody asks.
    """

    def __init__(
        self,
        adaptation: AdaptiveIdentifier,
        drive_v: AffineRange,
        position_um: AffineRange,
        history: DriveHistory,
        delay_ns: int,
        period_ns: int,
        convergence: Convergence | None,
        gate: LearningGate,
        creep: CreepState = AT_REST,
        modal: ModalMotion | None = None,
        errors: ModelErrors | None = None,
    ) -> None:
        self.adaptation, self.gate, self._modal = adaptation, gate, modal
        self.errors = errors
        """Errors of the identified and of the learned model for the last sample."""
        self._low_v, self._width_v = drive_v.low, drive_v.width
        self._low_um, self._width_um = position_um.low, position_um.width
        self._history, self._delay_ns, self._convergence = history, delay_ns, convergence
        self._creep_weights, self._creep_gains = creep.creep
        self._zeroed = creep.zeroed
        self._lags, self._quick = creep.lags.copy(), creep.quick
        # Bound once: a partial function adds no Python frame.
        self._advance_creep: Callable[[float], float] = partial(
            advance_creep, self._lags, self._creep_gains, self._creep_weights
        )
        self._waiting = deque[_Arrived]()
        self._cycles_early = max(0, -(delay_ns // period_ns))
        self.gain_halved = self._skipped_last = False
        """Whether only every second sample is learned from."""
        self._drive = self._beside = 0.0
        self.learned = False
        """Whether the last sample was learned from."""
        self.converged = False
        """Whether the weights have converged, over a window that ends with the last sample."""
        self.compared: Sample | None = None
        """The last sample whose voltage is known; None if it does not show how well the stage
        follows."""

    @property
    def weights(self) -> FloatArray:
        """Weights of the model, shape (size,); they change in place."""
        return self.adaptation.weights

    @property
    def offset(self) -> float:
        """Offset of the displacement, in units of the range; 0 if it is not learned."""
        return self.adaptation.offset

    @property
    def scale(self) -> float:
        """Relative gain of the hysteresis input over the displacement; 0 if it is not learned."""
        return self.adaptation.scale

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return self.adaptation.merged_pairs

    def restart(self, model: LearnedModel) -> None:
        """Start again from a model: what was learned is dropped."""
        self._beside = 0.0
        self.adaptation.adopt(model.weights, model.offset, model.scale)
        self.converged = False

    def error_of(self, model: LearnedModel) -> float:
        """Return the drive of the last sample minus its prediction by another model, normalised."""
        return self._drive - self.adaptation.predict(model.weights, model.offset, model.scale)

    def zero(self, zero: float, expected: float) -> None:
        """Take the present displacement as zero: the stage rests, and its sensor was zeroed.

        Args:
            zero: The zero of the sensor, normalised.
            expected: Displacement in the compensator's memory, normalised.
        """
        crept = float(self._creep_weights @ self._lags)
        self._zeroed = (expected + crept + self.offset) / (1.0 + self.scale) - zero
        self._waiting.clear()  # they count from the zero before

    def learn(
        self, t_ns: int, sample: Sample, *, limited: bool, expected: float, follows: bool = True
    ) -> None:
        """Take the sample of this cycle, and learn if the gate is open. Call once per cycle.

        Args:
            t_ns: Instant of the cycle, in ns.
            sample: The sample.
            limited: Whether range or slew rate limited the drive in force.
            expected: Displacement in the compensator's memory, normalised.
            follows: Whether the drive in force follows the command.
        """
        gate = self.gate
        position = (sample.position_um - self._low_um) / self._width_um
        # At rest S3 drops no sample. Far outside the range one would make a creep of many ranges,
        # from which wrong weights are learned. Without a model the range is unknown.
        valid = sample.valid and (self._convergence is not None or is_physical(position))
        drive, age_ns = self._drive_of(sample), t_ns - sample.t_ns
        admitted = gate.admits(
            valid=valid, age_ns=age_ns, limited=limited, drive=drive, position=position
        )
        comparable, accurate = follows and gate.comparable, gate.accurate
        learns = admitted
        if self._cycles_early:
            self._waiting.append(_Arrived(sample, admitted, accurate, comparable))
            if len(self._waiting) <= self._cycles_early:
                return
            sample, admitted, accurate, was_comparable = self._waiting.popleft()
            drive = self._drive_of(sample)  # which was not known when it arrived
            position = (sample.position_um - self._low_um) / self._width_um
            comparable = was_comparable and comparable
            # What closed the gate meanwhile may have spoilt the voltage that the sample waited for.
            learns = admitted and learns
        self.compared = sample if comparable else None
        if not accurate:
            position = nan  # the displacement that the compensator expects takes its place
        self._learn_from(sample.t_ns, position, drive, learns, expected)

    def _drive_of(self, sample: Sample) -> float:
        """Return the drive that a sample answers: the one in force one delay before it."""
        drive_v = self._history.at(sample.t_ns - self._delay_ns)
        return (drive_v - self._low_v) / self._width_v

    def _learn_from(
        self, sample_ns: int, position: float, drive: float, learns: bool, expected: float
    ) -> None:
        """Advance by a sample whose voltage is known, in force by now.

        If the position is NaN, the sample is not accurate. Then the memory advances with the
        displacement that the compensator expects: the stage moves anyway, and a missed extremum
        would be wrong for long. As far as the stage was beside that before, it still is: a step to
        the model and back would make an extremum that the stage has not seen.
        """
        crept = self._advance_creep(self._quick)
        if self._modal is not None:
            crept += self._modal.shown(sample_ns)
        self._drive = drive
        if self.gain_halved and learns:
            # Half of the samples halve the gain of any algorithm.
            self._skipped_last = not self._skipped_last
            learns = not self._skipped_last
        # Creep and modes are in the unit of the operators, the position in that of the sensor.
        adaptation = self.adaptation
        if self.errors is not None:
            self.errors.follow(drive, position + self._zeroed, crept)
        stretch = 1.0 + adaptation.scale
        modelled = (expected + adaptation.offset) / stretch
        if position == position:  # noqa: PLR0124 - not NaN
            without_creep = position + self._zeroed - crept / stretch
            self._beside += BESIDE_SHARE * (without_creep - modelled - self._beside)
        else:
            without_creep = modelled + self._beside
        # The error and its convergence follow paper eq. (30) and the criterion below it.
        convergence = self._convergence
        before = adaptation.position if convergence else 0.0
        adaptation.expect_noise(self.gate.noise_variance)
        error = adaptation.step(without_creep, drive, learns)
        self.learned = learns
        # The lags of the creep follow this displacement at the next sample.
        self._quick = (1.0 + adaptation.scale) * without_creep - adaptation.offset
        # At rest any weights predict well, so that only motion counts.
        if convergence and learns and adaptation.position != before:
            self.converged = convergence.update(error)
