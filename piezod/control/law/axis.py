"""The control law of one axis: from a sample and a reference to the voltage of the next cycle."""

from collections.abc import Callable
from math import nan
from typing import NamedTuple

from piezod.config.modes import Mode
from piezod.control.guard import Limits, Window
from piezod.control.law.compensator import Compensator
from piezod.control.law.identifier import DriveHistory, Identifier
from piezod.control.law.trim import Trim
from piezod.control.reference.motion import CornerFilter
from piezod.devices.interface import Sample
from piezod.hysteresis.normalisation import AffineRange
from piezod.telemetry.record import AxisRecord
from piezod.units import NS_PER_S

Waveform = Callable[[float], float]
"""A reference over time: seconds since its start to µm or V."""


class AxisOutput(NamedTuple):
    """What an axis asks for in one cycle.

    Attributes:
        drive_v: Voltage to write, within the limits.
        command_um: Displacement asked for at the instant of the sample, NaN for an open-loop drive.
        uncompensated_v: Voltage in proportion to that command.
        in_force_v: Voltage that was in force when the sample was taken.
        t_ns: Instant of the cycle that it is made for.
    """

    drive_v: float
    command_um: float
    uncompensated_v: float
    in_force_v: float
    t_ns: int


class CompensatedAxis:
    """Follows a displacement: reference → shape → normalise → trim → compensate within the limits.

    What is written in a cycle answers in the next one, after the delay: the reference is read that
    much ahead. The sensor's part of the delay is not counted: the stage itself is there earlier.
    Where the first mode is known, what is read ahead is shaped so that corners do not ring it; the
    record and the trim keep the reference as it is.

    Args:
        reference_um: Displacement over time since the start, in µm.
        drive_v: Range of the drive that is [0, 1] for the model, in V.
        position_um: Range of the displacement that is [0, 1] for the model, in µm.
        compensator: Command to drive, normalised.
        identifier: Samples to weights.
        history: Voltages in force, shared with the identifier.
        limits: What the drive may do.
        in_force_v: Voltage in force at the start.
        start_ns: Instant at which the reference starts.
        period_ns: Period of the loop.
        delay_ns: How long the displacement that is measured lags behind the voltage.
        sensor_delay_ns: Part of it that lies in the sensor: a sample shows the stage so long ago.
        trim: Integral of the measured error, for mode `trimmed`.
        first_mode_hz: Frequency of the first mechanical mode, in Hz; None where it is not known.
    """

    def __init__(
        self,
        *,
        reference_um: Waveform,
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
        trim: Trim,
        first_mode_hz: float | None = None,
    ) -> None:
        self._reference_um = reference_um
        self._drive_v, self._position_um = drive_v, position_um
        self.compensator, self.identifier = compensator, identifier
        self._history, self._limits = history, limits
        self._in_force_v = in_force_v
        self._start_ns, self._period_s = start_ns, period_ns / NS_PER_S
        self._awaits_write = False
        self._first_mode_hz = first_mode_hz
        self._shaped_um = CornerFilter(reference_um, first_mode_hz, self._period_s)
        self._ahead_s = (period_ns + delay_ns - sensor_delay_ns) / NS_PER_S
        self._sensor_delay_ns = sensor_delay_ns
        self.trim = trim
        self._forced_v = nan
        self.switch(compensator.mode)

    def switch(self, mode: Mode) -> None:
        """Change the mode; the drive goes over without a jump; may be called in the loop."""
        if mode is not self.compensator.mode:
            self.compensator.switch(mode)
        if mode is Mode.TRIMMED:
            self.trim.enable()
        else:
            self.trim.disable()

    def halve_gains(self, halved: bool) -> None:
        """Trim and learn with half the gain, or with the whole gain again. Real-time safe."""
        self.trim.gain_halved = self.identifier.gain_halved = halved

    def pause_learning(self, paused: bool) -> None:
        """Learn nothing from the next sample, or learn again. Real-time safe."""
        self.identifier.gate.skipped = paused

    @property
    def limits(self) -> Limits:
        """What the drive may do."""
        return self._limits

    @property
    def at_end_of_range(self) -> bool:
        """Whether the voltage in force is the lowest or the highest that the range allows."""
        low_v, high_v, _ = self._limits
        rounding_v = 1e-9 * (high_v - low_v)
        return not low_v + rounding_v < self._in_force_v < high_v - rounding_v

    @property
    def in_force_v(self) -> float:
        """Voltage in force, in V."""
        return self._in_force_v

    @property
    def command_here_um(self) -> float:
        """Command that leaves the drive as it is, in µm; may be called in the loop."""
        drive = self._drive_v.to_unit(self._in_force_v)
        return self._position_um.from_unit(self.compensator.command_here(drive, self.trim.value))

    @property
    def expected_um(self) -> float:
        """Displacement that the model expects the sensor to show, in µm; call it in the loop."""
        return self._position_um.from_unit(self.compensator.expected)

    @property
    def zeroed_range_um(self) -> AffineRange:
        """Range of the displacement that the model covers, in µm from rest."""
        return self._position_um

    def follow(self, reference_um: Waveform, start_ns: int) -> None:
        """Follow another reference from now on; may be called in the loop.

        Args:
            reference_um: Displacement over time since its start, in µm.
            start_ns: Instant at which it starts.
        """
        self._reference_um, self._start_ns = reference_um, start_ns
        self._shaped_um = CornerFilter(reference_um, self._first_mode_hz, self._period_s)
        self._forced_v = nan

    def force(self, drive_v: float) -> None:
        """Go to a voltage, whatever the reference; the memory follows; call it in the loop.

        Args:
            drive_v: Voltage for the next cycles, in V; within the limits as any other.
        """
        self._forced_v = drive_v

    def zero(self) -> None:
        """Count displacements from here on, where the stage rests; may be called in the loop."""
        self.compensator.zero()
        self.identifier.zero()

    def update(self, t_ns: int, sample: Sample) -> AxisOutput:
        """Identify from the sample, compensate the reference; may be called in the loop."""
        refused = self._awaits_write
        if refused:
            self.compensator.refused()
        self._awaits_write = True
        self._history.append(t_ns, self._in_force_v)
        limited, expected = self.compensator.limited, self.compensator.position
        self.identifier.learn(t_ns, sample, limited=limited, expected=expected)
        if self.identifier.converged:
            self.compensator.adopt_first(self.identifier.weights)
        t_s = (t_ns - self._start_ns) / NS_PER_S
        command_um = self._reference_um(t_s)
        forced = self._forced_v == self._forced_v
        credible = self.identifier.gate.credible and not (refused or forced)
        trim = 0.0
        if self.trim.active:
            trim = self.trim.step(self._lacks(sample), credible, self.compensator.stop)
        ahead = self._position_um.to_unit(self._shaped_um.value(t_s + self._ahead_s))
        window = self._limits.window(self._in_force_v, self._period_s)
        if forced:
            drive_v = window.admit(self._forced_v, self._in_force_v)
            window = Window(drive_v, drive_v)
        drive = self.compensator.step(
            ahead,
            self._drive_v.to_unit(window.low_v),
            self._drive_v.to_unit(window.high_v),
            self.identifier.weights,
            self.identifier.offset,
            self.identifier.scale,
            trim,
        )
        drive_v = window.admit(self._drive_v.from_unit(drive), self._in_force_v)
        uncompensated_v = self._drive_v.from_unit(self._position_um.to_unit(command_um))
        return AxisOutput(drive_v, command_um, uncompensated_v, self._in_force_v, t_ns)

    def applied(self, drive_v: float) -> None:
        """Learn what is in force from now on; may be called in the loop."""
        self._in_force_v = drive_v
        self._awaits_write = False

    def record(
        self,
        sample: Sample,
        output: AxisOutput,
        drive_v: float,
        read_back_v: float,
        *,
        target_um: float = nan,
        on_target: bool = False,
        motion: int = 0,
    ) -> AxisRecord:
        """Return what this cycle leaves. Real-time safe.

        Args:
            sample: The sample that was used.
            output: What the axis asked for.
            drive_v: Voltage that was written, in V.
            read_back_v: Voltage that the amplifier reports, in V; NaN if it does not.
            target_um: Position at which the movement ends, in µm; NaN if there is none.
            on_target: Whether the position has been reached and has stayed there.
            motion: Number of the movement.
        """
        return AxisRecord(
            sample.t_ns,
            sample.position_um if sample.valid else nan,
            output.command_um,
            target_um,
            output.uncompensated_v,
            output.drive_v,
            drive_v,
            output.in_force_v,
            read_back_v,
            self.trim.value * self._position_um.width,
            self.compensator.mode,
            self.identifier.gate.reason,
            on_target,
            motion,
        )

    def _lacks(self, sample: Sample) -> float:
        """Return what a sample lacks to the command of the instant it shows, in units of range."""
        shown_s = (sample.t_ns - self._sensor_delay_ns - self._start_ns) / NS_PER_S
        error_um = self._reference_um(shown_s) - sample.position_um
        return error_um / self._position_um.width
