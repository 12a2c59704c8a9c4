"""The control law of one axis: from a sample and a reference to the voltage of the next cycle.

Paper, section 3 and Fig. 4: reference, inverse compensator, identifier and switch.
"""

from collections.abc import Callable, Mapping
from math import nan
from typing import Final

from piezod.config.drive_limits import DriveLimit
from piezod.config.modes import Mode
from piezod.control.guard import Limits, admit_within
from piezod.control.law.compensator import Compensator, DriveHistory
from piezod.control.law.dynamics import ModalMotion
from piezod.control.law.identifier import Identifier
from piezod.control.law.learned_models import LearnedBound, ModelProof
from piezod.control.law.trim import Trim
from piezod.control.reference.preview import ReferenceShaper
from piezod.devices.interface import Sample
from piezod.hysteresis import LearnedModel
from piezod.hysteresis.normalisation import AffineRange
from piezod.telemetry.record import AxisRecord
from piezod.units import NS_PER_S

_ROUNDING: Final = 1e-9  # of normalised units
_FREE: Final = DriveLimit.NONE


TimeFunction = Callable[[float], float]
"""A quantity over time: seconds since its start to µm or V."""


class AxisOutput:
    """Output of an axis in one cycle.

    Args:
        drive_v: Voltage to write, within the limits, in V.
        command_um: Command at the instant of the cycle, in µm; NaN for an open-loop drive.
        uncompensated_v: Voltage in proportion to that command, in V.
        in_force_v: Voltage that was in force when the sample was taken, in V.
        t_ns: Instant of the cycle for which it was made, in ns.
        limited: What keeps the drive from following the command; a forced voltage has none.
    """

    __slots__ = ("command_um", "drive_v", "in_force_v", "limited", "t_ns", "uncompensated_v")

    def __init__(
        self,
        drive_v: float,
        command_um: float,
        uncompensated_v: float,
        in_force_v: float,
        t_ns: int,
        limited: DriveLimit = _FREE,
    ) -> None:
        self.drive_v, self.command_um, self.uncompensated_v = drive_v, command_um, uncompensated_v
        self.in_force_v, self.t_ns, self.limited = in_force_v, t_ns, limited


class CompensatedAxis:
    """Makes an axis follow a reference: shape → normalise → trim → compensate within the limits.

    All methods are real-time safe.

    A voltage that is written in a cycle shows in the next one, after the delay. So the axis reads
    the reference that much ahead, shaped for the modes, if they are known. The sensor's part of the
    delay does not count: the stage itself is there earlier. Record and trim use the reference as it
    is.

    Args:
        reference_um: Position over time since the start, in µm.
        drive_v: Range of the drive that is [0, 1] for the model, in V.
        position_um: Range of the displacement that is [0, 1] for the model, in µm.
        compensator: Normalised command to normalised drive.
        identifier: Samples to weights.
        history: Voltages in force, shared with the identifier.
        limits: Limits of the drive.
        in_force_v: Voltage in force at the start, in V.
        start_ns: Instant at which the reference starts, in ns.
        period_ns: Period of the loop, in ns.
        delay_ns: Delay of a sample behind the voltage, in ns, without that of known modes.
        sensor_delay_ns: Part of that delay that lies in the sensor: the age of the displacement
            that a sample shows, in ns.
        feedbacks: Feedback of the measured error, for each mode that has one.
        proof: Keeps the last learned model that has proved itself.
        shaper: Shapes references for the modes.
        modal: Part of the displacement that the modes add; None if they are unknown.
        bound: Keeps the learned model near the identified one; None if there is no such model.
        rests_inside: Whether it rests inside its range: where depends on where the voltage was.
    """

    def __init__(
        self,
        *,
        reference_um: TimeFunction,
        drive_v: AffineRange,
        position_um: AffineRange,
        compensator: Compensator,
        identifier: Identifier,
        history: DriveHistory,
        limits: Limits,
        in_force_v: float,
        start_ns: int,
        period_ns: int,
        delay_ns: int,
        sensor_delay_ns: int,
        feedbacks: Mapping[Mode, Trim],
        proof: ModelProof,
        shaper: ReferenceShaper,
        modal: ModalMotion | None = None,
        bound: LearnedBound | None = None,
        rests_inside: bool = False,
    ) -> None:
        self.rests_inside = rests_inside
        self._reference_um = reference_um
        self._low_v, self._width_v = drive_v.low, drive_v.width
        self._low_um, self._width_um = position_um.low, position_um.width
        self.compensator, self.identifier = compensator, identifier
        self._history = history
        self.limits, self.in_force_v = limits, in_force_v
        """Limits of the drive, and the voltage in force, in V."""
        self._start_ns, self._period_s = start_ns, period_ns / NS_PER_S
        self._write_pending = False
        self._shaper, self._modal = shaper, modal
        self._shaped_reference = shaper.shape(reference_um, moving=False)
        # A voltage that is written in this cycle shows one period and one delay later.
        self._lookahead_s = (period_ns + delay_ns - sensor_delay_ns) / NS_PER_S
        self._sensor_delay_ns = sensor_delay_ns
        self._feedbacks, self.proof, self.bound = feedbacks, proof, bound
        self.trim = next(iter(feedbacks.values()))
        """The feedback in use, or the one that still fades."""
        self._forced_v = nan
        self.switch(compensator.mode)

    def switch(self, mode: Mode) -> None:
        """Change the mode; the drive changes over without a jump."""
        if mode is not self.compensator.mode:
            proven = self.proof.proven  # perhaps of an instant between two looks at the bound
            self.compensator.switch(mode, self.bound.limited(proven) if self.bound else proven)
        feedback = self._feedbacks.get(mode)
        if feedback is None:
            self.trim.disable()
            return
        if feedback is not self.trim:
            feedback.take_over(self.trim)
            self.trim = feedback
        feedback.enable()

    def refusal(self, mode: Mode) -> str:
        """Return why a mode must not be selected; empty if it may."""
        return self._feedbacks[mode].refusal if mode in self._feedbacks else ""

    def halve_gains(self, halved: bool) -> None:
        """Feed back and learn with half the gain, or with the full gain again."""
        for each in self._feedbacks.values():
            each.gain_halved = halved
        self.identifier.gain_halved = halved

    def doubt(self, doubted: bool) -> None:
        """Drop what was learned if the samples begin to be in doubt; learn nothing meanwhile.

        Nobody knows since when they were wrong: no model that was learned from them is proven.
        """
        if doubted and not self.identifier.gate.doubted:
            self._drop_learned()
            self.compensator.restart(self.proof.first)
        self.identifier.gate.doubted = doubted

    def pause_learning(self) -> None:
        """Learn nothing from the next samples: periods were skipped, so the drive came late."""
        self.identifier.gate.skip()

    @property
    def holding_command_um(self) -> float:
        """Command that leaves the drive as it is, in µm."""
        drive = (self.in_force_v - self._low_v) / self._width_v
        return self._low_um + (
            self.compensator.holding_command(drive, self.trim.value) * self._width_um
        )

    @property
    def expected_um(self) -> float:
        """Position that the model expects the sensor to show, in µm."""
        return self._low_um + self.compensator.expected * self._width_um

    def follow(self, reference_um: TimeFunction, start_ns: int) -> None:
        """Follow another reference from now on.

        Args:
            reference_um: Position over time since its start, in µm.
            start_ns: Instant at which it starts, in ns.
        """
        self._reference_um, self._start_ns = reference_um, start_ns
        forced = self._forced_v == self._forced_v
        self._shaped_reference = self._shaper.shape(reference_um, moving=not forced)
        self._forced_v = nan

    def force(self, drive_v: float) -> None:
        """Drive a voltage instead of the reference; the hysteresis memory follows.

        Args:
            drive_v: Voltage for the next cycles, in V; the limits apply.
        """
        self._forced_v = drive_v

    def zero(self) -> None:
        """Take the present displacement, at rest, as zero."""
        zero = -self._low_um / self._width_um
        self.compensator.zero(zero)
        self.identifier.zero(zero, self.compensator.position)

    def update(self, t_ns: int, sample: Sample) -> AxisOutput:
        """Learn from the sample and compensate the reference; return the voltage to write.

        Call once per cycle.
        """
        not_applied = self._write_pending
        if not_applied:
            self.compensator.discard_last()
        self._write_pending = True
        # The write of the cycle before, or the old voltage if that write was not applied, is in
        # force now.
        compensator, identifier = self.compensator, self.identifier
        in_force_v, low_um, width_um = self.in_force_v, self._low_um, self._width_um
        self._history.append(t_ns, in_force_v)
        limited, expected = compensator.limited, compensator.position
        if self._modal is not None:
            self._modal.advance(t_ns, expected)
        forced = self._forced_v == self._forced_v
        follows = not (forced or not_applied)
        identifier.learn(t_ns, sample, limited=limited, expected=expected, follows=follows)
        if self.bound is not None:
            self.bound.update()
        # Paper, section 3, switch turned off: copy the parameters once they have converged.
        if identifier.converged and compensator.adopt_first(identifier.weights):
            self.proof.restart(LearnedModel(identifier.weights))
        t_s = (t_ns - self._start_ns) / NS_PER_S
        command_um = self._reference_um(t_s)
        # The error of a forced voltage, or of a write that was not applied, is no error of the
        # model.
        if follows and compensator.adapts:
            self._prove_model(command_um)
        trim = 0.0
        if self.trim.active:
            gate = identifier.gate
            credible = gate.credible and follows and not gate.skipped
            trim = self.trim.step(self._error_of(sample), credible, compensator.limited_direction)
        # The value that the voltage of this cycle will reach, when it acts.
        ahead = (self._shaped_reference.value(t_s + self._lookahead_s) - low_um) / width_um
        window = self.limits.window(in_force_v, self._period_s)
        if forced:
            drive_v = admit_within(window, self._forced_v, in_force_v)
            # A window of no width makes the compensator follow the forced voltage, with its memory.
            window = drive_v, drive_v
        low_v, width_v, adaptation = self._low_v, self._width_v, identifier.adaptation
        drive = compensator.step(
            ahead,
            (window[0] - low_v) / width_v,
            (window[1] - low_v) / width_v,
            adaptation.weights,
            adaptation.offset,
            adaptation.scale,
            trim,
        )
        drive_v = admit_within(window, low_v + drive * width_v, in_force_v)
        # Paper, section 3: x_r = V_r in normalised units.
        uncompensated_v = low_v + (command_um - low_um) / width_um * width_v
        by = _FREE if forced else what_limits(compensator, self.limits, drive_v)
        return AxisOutput(drive_v, command_um, uncompensated_v, in_force_v, t_ns, by)

    def applied(self, drive_v: float) -> None:
        """Take the voltage that is in force from now on, in V."""
        self.in_force_v = drive_v
        self._write_pending = False

    def record(  # noqa: D417 - arguments are described in groups
        self,
        sample: Sample,
        output: AxisOutput,
        drive_v: float,
        read_back_v: float,
        target_um: float = nan,
        on_target: bool = False,
        motion: int = 0,
        remaining_s: float = nan,
    ) -> AxisRecord:
        """Return the record of this cycle.

        Args:
            sample: The sample that was used.
            output: The output of the axis.
            drive_v: Voltage that was written, in V.
            read_back_v: Voltage that the amplifier reports, in V; NaN if it does not.
            target_um, on_target, motion, remaining_s: Fields of the record about the movement.
        """
        fields = (
            sample.t_ns,
            sample.position_um if sample.valid else nan,
            output.command_um,
            target_um,
            output.uncompensated_v,
            output.drive_v,
            drive_v,
            output.in_force_v,
            read_back_v,
            self.trim.value * self._width_um,
            self.compensator.mode,
            self.identifier.gate.reason,
            on_target,
            motion,
            output.limited,
            remaining_s,
        )
        return tuple.__new__(AxisRecord, fields)  # a call of the class takes three times as long

    def _prove_model(self, command_um: float) -> None:
        """Compare the learned model with the first one, and go back to that if it was worse."""
        sample = self.identifier.compared
        if sample is None:
            return
        identifier, proof = self.identifier, self.proof
        errors = identifier.errors
        if errors and identifier.learned:
            use, noise = proof.use, identifier.gate.noise_variance
            if use.add(errors.learned, errors.first, errors.of_lag, noise, errors.change):
                self.compensator.use_learned(use.used, proof.first)
        if not self.compensator.learns_in_use:
            return
        command = (command_um - self._low_um) / self._width_um
        first_error = identifier.error_of(proof.first)
        if proof.add(command, self._error_of(sample), first_error, self.compensator):
            self._drop_learned()
            self.compensator.fade()

    def _drop_learned(self) -> None:
        """Let the identifier start again from the first model."""
        self.identifier.restart(self.proof.first)
        self.proof.restart(self.proof.first)
        self.compensator.use_learned(True, self.proof.first)
        if self.bound is not None:
            self.bound.returned()

    def _error_of(self, sample: Sample) -> float:
        """Return the error at the instant that a sample shows, in units of the range."""
        # The sample shows the stage at its time stamp minus the delay of the sensor.
        shown_s = (sample.t_ns - self._sensor_delay_ns - self._start_ns) / NS_PER_S
        error_um = self._reference_um(shown_s) - sample.position_um
        return error_um / self._width_um


def what_limits(compensator: Compensator, limits: Limits, drive_v: float) -> DriveLimit:
    """Return what keeps a drive from following its command. Real-time safe.

    Args:
        compensator: It has made the drive.
        limits: Limits of the drive.
        drive_v: The drive, in V.
    """
    if not compensator.limited:
        return DriveLimit.RANGE if compensator.out_of_reach else _FREE
    low_v, high_v = limits.drive_min_v, limits.drive_max_v
    rounding_v = _ROUNDING * (high_v - low_v)
    inside = low_v + rounding_v < drive_v < high_v - rounding_v
    return DriveLimit.SLEW if inside else DriveLimit.RANGE
