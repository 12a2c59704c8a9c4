"""One axis of a running stage: the motion or the voltage that it drives from cycle to cycle.

The control law runs in every case. To hold, ramp or drive a voltage, that voltage is forced on the
law, so that its hysteresis memory follows, and a later command starts without a jump.
"""

from collections.abc import Callable
from math import ceil, isfinite, nan
from typing import NamedTuple

from piezod.config.daemon import StageAxisConfig
from piezod.config.modes import Mode
from piezod.config.waveforms.waveform import Waveform
from piezod.control.law.axis import AxisOutput, CompensatedAxis
from piezod.control.reference.edge_clock import EdgeClock
from piezod.control.reference.motion import (
    Motion,
    StreamedReference,
    lead_in,
    motion_limits,
    rejoin,
    rest_at,
    smooth_motion,
    waveform_motion,
)
from piezod.control.reference.programs import VoltageProgram
from piezod.control.signals import OnTarget
from piezod.devices.interface import Sample
from piezod.telemetry.record import AxisRecord
from piezod.units import NS_PER_S, s_to_ns

ROUNDING_V = 1e-6
"""Two voltages are equal within this, in V."""


class _Movement(NamedTuple):
    """A movement of an axis, kept while its voltage is held."""

    motion: Motion
    started_ns: int
    number: int
    stream: StreamedReference | None
    follows_input: bool


class StageAxis:
    """One axis of a running stage. All methods are real-time safe.

    Args:
        name: Name of the axis.
        config: Configuration of the axis.
        law: Control law of the axis.
        period_ns: Period of the loop, in ns.
        range_um: Lowest and highest position that may be commanded, in µm.
    """

    def __init__(
        self,
        name: str,
        config: StageAxisConfig,
        law: CompensatedAxis,
        period_ns: int,
        range_um: tuple[float, float],
    ) -> None:
        self.name, self.config, self.law = name, config, law
        self._period_s = period_ns / NS_PER_S
        self.motion_limits = motion_limits(config, range_um, self._period_s)
        self._voltage: Callable[[int], float] = lambda _t_ns: self.law.in_force_v
        self._forced = True
        self._ends_ns, self._ramps_to_v = 0, nan
        self._held_v = nan  # while it is held
        self.ramp_cycles = 0
        """Cycles that the present ramp should still take; negative if it is overdue."""
        self.waits = self.lost = False
        """Whether the output does not follow, and whether not even the last write is in reach."""
        self.waited_cycles = 0
        """Cycles that the present ramp has waited for the output."""
        self.command_um = nan
        """Command of the last cycle, in µm; NaN if there was none."""
        self._motion, self._started_ns, self._arrives_ns = rest_at(nan), 0, 0
        self._clock: EdgeClock | None = None
        self.stream: StreamedReference | None = None
        self.follows_input = False
        """Whether the setpoints come from the command input of the axis."""
        self.commanded_ns = 0
        """Instant of the newest allowed setpoint, of a stream or of the command input, in ns."""
        self.motion = 0
        """Number of the movement; each movement gets the next number."""
        settle = s_to_ns(config.on_target.settle_s) // period_ns
        self._on_target = OnTarget(config.on_target.tolerance_um, settle)
        self._is_on_target = False
        self._paused: _Movement | None = None
        self.crash: Exception | None = None
        """Exception of the control law, if it raised one; the voltage is held meanwhile."""

    @property
    def mode(self) -> Mode:
        """Mode in which the drive is made from the command."""
        return self.law.compensator.mode

    @property
    def has_sensor(self) -> bool:
        """Whether a sensor measures the axis."""
        return self.config.sensor is not None

    @property
    def following(self) -> bool:
        """Whether the axis follows a command."""
        return not self._forced

    def select(self, mode: Mode) -> None:
        """Change the mode without a jump."""
        self.law.switch(mode)

    # ------------------------------------------------------------------ voltages

    def hold(self) -> None:
        """Hold the voltage in force."""
        held_v = self.law.in_force_v
        if held_v != self._held_v or self._paused is not None:
            self._force(lambda _t_ns: held_v, 0)
            self._held_v = held_v

    def pause(self) -> None:
        """Hold the voltage in force, and keep the movement for `rejoin`."""
        movement = _Movement(
            self._motion, self._started_ns, self.motion, self.stream, self.follows_input
        )
        followed = self.following
        self.hold()
        self._paused = movement if followed else None

    def track(self, drive_v: float) -> None:
        """Take over a read-back voltage, in V, while nothing is written."""
        self.law.applied(drive_v)
        self.hold()

    def drive(self, drive: VoltageProgram, t_ns: int) -> None:
        """Drive a voltage over time, from an instant on."""
        program = drive.drive_v
        self._force(
            lambda now_ns: program((now_ns - t_ns) / NS_PER_S), t_ns + s_to_ns(drive.duration_s)
        )

    def ramp_to(self, drive_v: float) -> None:
        """Go to a voltage, in V, at the rate of the safe ramp.

        Each step starts at the voltage in force, so that a pause or a refused write makes no larger
        step.
        """
        step_v = self.config.safety.ramp_v_per_s * self._period_s
        self.ramp_cycles = ceil(abs(drive_v - self.law.in_force_v) / step_v)

        def voltage(_t_ns: int) -> float:
            in_force_v = self.law.in_force_v
            self.ramp_cycles -= 1
            return in_force_v + min(max(drive_v - in_force_v, -step_v), step_v)

        self._force(voltage, 0)
        # After `_force`, which clears it.
        self._ramps_to_v = drive_v

    def wait(self, *, lost: bool) -> None:
        """Take a cycle in which the output was waited for: a ramp has not gone on.

        Args:
            lost: Whether nothing was written, because the last write is out of reach of the output.
        """
        self.waits, self.lost = True, lost
        self.waited_cycles += 1
        self.ramp_cycles += 1

    def drive_ended(self, t_ns: int) -> bool:
        """Return whether the driven voltage has reached its end and has been written."""
        if isfinite(self._ramps_to_v):
            return abs(self.law.in_force_v - self._ramps_to_v) <= ROUNDING_V
        return t_ns > self._ends_ns

    def _force(self, voltage: Callable[[int], float], ends_ns: int) -> None:
        self._voltage, self._forced, self._ends_ns = voltage, True, ends_ns
        self._ramps_to_v = self._held_v = nan
        self._motion, self.stream, self._is_on_target = rest_at(nan), None, False
        self.follows_input, self._paused = False, None

    # ------------------------------------------------------------------ movements

    def stay(self, t_ns: int) -> None:
        """Follow a constant command that leaves the drive as it is."""
        self.move(rest_at(self.law.holding_command_um), t_ns)

    def rejoin(self, t_ns: int) -> None:
        """Go on with the movement that was paused, where it would be now; without a jump."""
        paused = self._paused
        if paused is None:
            self.stay(t_ns)
        elif paused.stream is not None:
            self.follow_stream(t_ns)
            self.follows_input = paused.follows_input
        else:
            elapsed_s, start_um = (t_ns - paused.started_ns) / NS_PER_S, self.law.holding_command_um
            self.move(rejoin(paused.motion, elapsed_s, start_um, self.motion_limits), t_ns)
        if paused is not None:
            self.motion = paused.number  # for clients it is the same movement

    def on_target_in_s(self, t_ns: int) -> float:
        """Return the time until the axis can be on target, in s: the rest of its way, and settling.

        Args:
            t_ns: Instant of the cycle, in ns.
        """
        return self.way_s(t_ns) + self.config.on_target.settle_s

    def go_to(self, position_um: float, speed_um_per_s: float | None, t_ns: int) -> None:
        """Move to a position."""
        limits = self.motion_limits
        if speed_um_per_s is not None:
            limits = limits._replace(speed_um_per_s=speed_um_per_s)
        start_um, start_um_per_s = self.reference_at(t_ns)
        self.move(smooth_motion(start_um, start_um_per_s, position_um, limits), t_ns)

    def lead_in(self, waveform: Waveform, t_ns: int) -> Motion:
        """Return the movement to the start of a waveform."""
        return lead_in(waveform, *self.reference_at(t_ns), self.motion_limits)

    def follow(
        self,
        waveform: Waveform,
        duration_s: float,
        t_ns: int,
        start_ns: int = 0,
        clock: EdgeClock | None = None,
    ) -> None:
        """Follow a waveform.

        Args:
            waveform: Position over time, in µm.
            duration_s: Its duration, in s.
            t_ns: Instant of the cycle, in ns.
            start_ns: Instant at which the waveform begins, in ns; as soon as the axis is at its
                start if that is later.
            clock: The time of the movement, if it waits for edges.
        """
        begins_s = (start_ns - t_ns) / NS_PER_S
        motion = waveform_motion(waveform, duration_s, self.lead_in(waveform, t_ns), begins_s)
        if clock is not None:
            reference_um, at_s = motion.reference_um, clock.at_s
            motion = motion._replace(reference_um=lambda t_s: reference_um(at_s(t_s)))
        self.move(motion, t_ns)
        self._clock = clock

    def follow_stream(self, t_ns: int) -> None:
        """Follow the setpoints of a stream."""
        start_um, _ = self.reference_at(t_ns)
        stream = StreamedReference(start_um, self.motion_limits, self._period_s)
        self.move(Motion(stream, 0.0, nan), t_ns)
        self.stream, self.commanded_ns = stream, t_ns

    def follow_input(self, t_ns: int) -> None:
        """Follow the command input; `take_command` takes its values."""
        self.follow_stream(t_ns)
        self.follows_input = True

    def take_command(self, sample: Sample) -> None:
        """Take a value of the command input; values that are not allowed are ignored."""
        if (
            self.stream is not None
            and sample.valid
            and self.motion_limits.allow(sample.position_um)
        ):
            self.stream.newest_um = sample.position_um
            self.commanded_ns = max(self.commanded_ns, sample.t_ns)

    def move(self, motion: Motion, t_ns: int) -> None:
        """Start a movement."""
        self._motion, self._started_ns, self._forced = motion, t_ns, False
        self._held_v, self._clock = nan, None
        self._arrives_ns = t_ns + s_to_ns(motion.duration_s)
        self.stream, self._is_on_target, self.follows_input = None, False, False
        self._on_target.restart()
        self.law.follow(motion.reference_um, t_ns)
        self.motion += 1

    def reference_at(self, t_ns: int) -> tuple[float, float]:
        """Return position and speed of the reference, in µm and µm/s."""
        if self._forced:
            return self.law.holding_command_um, 0.0
        t_s = (t_ns - self._started_ns) / NS_PER_S
        here_um = self._motion.reference_um(t_s)
        return here_um, (self._motion.reference_um(t_s + self._period_s) - here_um) / self._period_s

    # ------------------------------------------------------------------ the cycle

    def update(self, t_ns: int, sample: Sample) -> AxisOutput:
        """Take the sample of this cycle; return the voltage to write."""
        self.waits = False
        try:
            if self._forced:
                self.law.force(self._voltage(t_ns))
            elif self.stream is not None:
                self.stream.advance()
            output = self.law.update(t_ns, sample)
        except Exception as error:  # noqa: BLE001 - a mistake in the law must not drop the voltage
            self.crash = error
            return AxisOutput(self.law.in_force_v, nan, nan, self.law.in_force_v, t_ns)
        if self._forced:  # a forced voltage has no command
            output.command_um = output.uncompensated_v = self.command_um = nan
            return output
        self.command_um = output.command_um
        arrived = sample.valid and not self.way_s(t_ns)
        error_um = output.command_um - sample.position_um if arrived else nan
        self._is_on_target = self._on_target.update(error_um)
        return output

    def applied(self, drive_v: float) -> None:
        """Take the voltage that is in force from now on, in V."""
        self.law.applied(drive_v)

    def record(
        self, sample: Sample, output: AxisOutput, drive_v: float, read_back_v: float
    ) -> AxisRecord:
        """Return the record of this cycle; arguments as for `CompensatedAxis.record`."""
        target_um = self._motion.target_um
        return self.law.record(
            sample,
            output,
            drive_v,
            read_back_v,
            target_um,
            self._is_on_target,
            self.motion,
            self.way_s(output.t_ns) if isfinite(target_um) else nan,
        )

    def way_s(self, t_ns: int) -> float:
        """Return the time until the movement is at its end, in s."""
        clock = self._clock
        if clock is not None:
            if clock.ended:
                return 0.0
            t_ns = self._started_ns + round(clock.at_ns(t_ns - self._started_ns))
        return max(self._arrives_ns - t_ns, 0) / NS_PER_S
