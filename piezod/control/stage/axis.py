"""One axis of a stage that a daemon owns: what it does, from cycle to cycle.

Whatever is done, the compensated axis runs: where a voltage is held, ramped or driven, it is forced
on it, so that its memory follows and the way back to following a command is without a jump.
"""

from collections.abc import Callable
from math import ceil, isfinite, nan

from piezod.config.daemon import StageAxisConfig
from piezod.config.modes import Mode
from piezod.control.law.axis import AxisOutput, CompensatedAxis
from piezod.control.reference.motion import (
    Motion,
    MotionLimits,
    StreamedReference,
    rest_at,
    smooth_motion,
    waveform_motion,
)
from piezod.control.reference.programs import VoltageProgram
from piezod.control.reference.waveforms import Waveform
from piezod.devices.interface import Sample
from piezod.telemetry.record import AxisRecord
from piezod.units import NS_PER_S, s_to_ns


class OnTarget:
    """Watches the measured position of one axis.

    Args:
        tolerance_um: Largest error, in µm.
        settle_cycles: For how many cycles the error stays below that.
    """

    def __init__(self, tolerance_um: float, settle_cycles: int) -> None:
        self._tolerance_um, self._settle_cycles = tolerance_um, settle_cycles
        self._cycles = 0

    def restart(self) -> None:
        """Wait for another position; may be called in the loop."""
        self._cycles = 0

    def update(self, error_um: float) -> bool:
        """Take the error of a cycle, NaN for none; return whether the position is reached.

        May be called in the loop.
        """
        close = abs(error_um) <= self._tolerance_um
        self._cycles = self._cycles + 1 if close else 0
        return self._cycles > self._settle_cycles


SHORTEST_MOTION_PERIODS = 3.0
"""The shortest way takes this many periods of the first mode, or of the loop where none is known"""
SHORTEST_MOTION_CYCLES = 10
ROUNDING_V = 1e-6
"""A voltage is the one that was asked for within this."""


class StageAxis:
    """Implements `Axis` for a daemon.

    Args:
        name: Its name.
        config: Its configuration.
        live: Its control law.
        period_ns: Period of the loop.
    """

    def __init__(
        self, name: str, config: StageAxisConfig, live: CompensatedAxis, period_ns: int
    ) -> None:
        self.name, self.config, self.live = name, config, live
        self._period_s = period_ns / NS_PER_S
        self.motion_limits = _motion_limits(config, live, self._period_s)
        self._voltage: Callable[[int], float] = lambda _t_ns: self.live.in_force_v
        self._forced = True
        self._ends_ns, self._ramps_to_v = 0, nan
        self.ramp_cycles = 0
        """Cycles that the ramp under way should still take; negative once it is overdue."""
        self.command_um = nan
        """Command of the last cycle, NaN where there was none."""
        self._motion, self._started_ns, self._arrives_ns = rest_at(nan), 0, 0
        self.stream: StreamedReference | None = None
        self.follows_input = False
        """Whether the setpoints of the stream are those of its command input."""
        self.commanded_ns = 0
        """Instant of the newest usable setpoint, of a stream or of the command input."""
        self.motion = 0
        """Number of the movement, one more with each."""
        settle = s_to_ns(config.on_target.settle_s) // period_ns
        self._on_target = OnTarget(config.on_target.tolerance_um, settle)
        self._reached = False
        self.crash: Exception | None = None
        """What the control law raised, if it did; the voltage is held since."""

    @property
    def mode(self) -> Mode:
        """How the drive is made from the command."""
        return self.live.compensator.mode

    @property
    def following(self) -> bool:
        """Whether it follows a command."""
        return not self._forced

    def select(self, mode: Mode) -> None:
        """Change the mode without a jump; may be called in the loop."""
        self.live.switch(mode)

    # ------------------------------------------------------------------ voltages

    def hold(self) -> None:
        """Hold what is in force; may be called in the loop."""
        held_v = self.live.in_force_v
        self._force(lambda _t_ns: held_v, 0)

    def track(self, drive_v: float) -> None:
        """Take over what the amplifier tells is in force, while nothing is written."""
        self.live.applied(drive_v)
        self.hold()

    def drive(self, drive: VoltageProgram, t_ns: int) -> None:
        """Drive a voltage over time, from an instant on; may be called in the loop."""
        program = drive.drive_v
        self._force(
            lambda now_ns: program((now_ns - t_ns) / NS_PER_S), t_ns + s_to_ns(drive.duration_s)
        )

    def ramp_to(self, drive_v: float) -> None:
        """Go to a voltage at the rate of the safe ramp; may be called in the loop.

        Step by step from what is in force: after a pause, or a write that was not taken, it goes on
        from there, and no faster.
        """
        step_v = self.config.safety.ramp_v_per_s * self._period_s
        self.ramp_cycles = ceil(abs(drive_v - self.live.in_force_v) / step_v)

        def voltage(_t_ns: int) -> float:
            in_force_v = self.live.in_force_v
            self.ramp_cycles -= 1
            return in_force_v + min(max(drive_v - in_force_v, -step_v), step_v)

        self._force(voltage, 0)
        self._ramps_to_v = drive_v

    def drive_ended(self, t_ns: int) -> bool:
        """Tell whether what is driven has come to its end, its last value written."""
        if isfinite(self._ramps_to_v):
            return abs(self.live.in_force_v - self._ramps_to_v) <= ROUNDING_V
        return t_ns > self._ends_ns

    def _force(self, voltage: Callable[[int], float], ends_ns: int) -> None:
        self._voltage, self._forced, self._ends_ns = voltage, True, ends_ns
        self._ramps_to_v = nan
        self._motion, self.stream, self._reached = rest_at(nan), None, False
        self.follows_input = False

    # ------------------------------------------------------------------ movements

    def stay(self, t_ns: int) -> None:
        """Follow a command that leaves the drive as it is; may be called in the loop."""
        self._move(rest_at(self.live.holding_command_um), t_ns)

    def go_to(self, position_um: float, speed_um_per_s: float | None, t_ns: int) -> int:
        """Move to a position; return the number of the movement; may be called in the loop."""
        limits = self.motion_limits
        if speed_um_per_s is not None:
            limits = limits._replace(speed_um_per_s=speed_um_per_s)
        start_um, start_um_per_s = self._reference_at(t_ns)
        return self._move(smooth_motion(start_um, start_um_per_s, position_um, limits), t_ns)

    def follow(self, waveform: Waveform, duration_s: float, t_ns: int) -> int:
        """Follow a waveform; return the number of the movement; may be called in the loop."""
        start_um, start_um_per_s = self._reference_at(t_ns)
        return self._move(
            waveform_motion(waveform, duration_s, start_um, start_um_per_s, self.motion_limits),
            t_ns,
        )

    def follow_stream(self, t_ns: int) -> int:
        """Follow the setpoints of a stream; return the number of the movement."""
        start_um, _ = self._reference_at(t_ns)
        stream = StreamedReference(start_um, self.motion_limits, self._period_s)
        number = self._move(Motion(stream, 0.0, nan), t_ns)
        self.stream, self.commanded_ns = stream, t_ns
        return number

    def follow_input(self, t_ns: int) -> int:
        """Follow the command input; return the number of the movement; may be called in the loop.

        What it tells is taken by `command`.
        """
        number = self.follow_stream(t_ns)
        self.follows_input = True
        return number

    def command(self, told: Sample) -> None:
        """Take what the command input tells; what is not usable counts as none."""
        if self.stream is not None and told.valid and usable(told.position_um, self.motion_limits):
            self.stream.newest_um = told.position_um
            self.commanded_ns = max(self.commanded_ns, told.t_ns)

    def _move(self, motion: Motion, t_ns: int) -> int:
        self._motion, self._started_ns, self._forced = motion, t_ns, False
        self._arrives_ns = t_ns + s_to_ns(motion.duration_s)
        self.stream, self._reached, self.follows_input = None, False, False
        self._on_target.restart()
        self.live.follow(motion.reference_um, t_ns)
        self.motion += 1
        return self.motion

    def _reference_at(self, t_ns: int) -> tuple[float, float]:
        """Return where the reference is, in µm, and its speed, in µm/s."""
        if self._forced:
            return self.live.holding_command_um, 0.0
        t_s = (t_ns - self._started_ns) / NS_PER_S
        here_um = self._motion.reference_um(t_s)
        return here_um, (self._motion.reference_um(t_s + self._period_s) - here_um) / self._period_s

    # ------------------------------------------------------------------ the cycle

    def update(self, t_ns: int, sample: Sample) -> AxisOutput:
        """Take the sample of this cycle; return what to write; may be called in the loop."""
        try:
            if self._forced:
                self.live.force(self._voltage(t_ns))
            elif self.stream is not None:
                self.stream.advance()
            output = self.live.update(t_ns, sample)
        except Exception as error:  # noqa: BLE001 - a mistake in the law must not drop the voltage
            self.crash = error
            return AxisOutput(self.live.in_force_v, nan, nan, self.live.in_force_v, t_ns)
        if self._forced:  # what it drives answers to no command
            output = AxisOutput(output.drive_v, nan, nan, output.in_force_v, t_ns)
        self.command_um = output.command_um
        self._judge(t_ns, sample)
        return output

    def _judge(self, t_ns: int, sample: Sample) -> None:
        error_um = self.command_um - sample.position_um if sample.valid else nan
        arrived = not self._forced and t_ns >= self._arrives_ns
        self._reached = self._on_target.update(error_um if arrived else nan)

    def applied(self, drive_v: float) -> None:
        """Learn what is in force from now on; may be called in the loop."""
        self.live.applied(drive_v)

    def record(
        self, sample: Sample, output: AxisOutput, drive_v: float, read_back_v: float
    ) -> AxisRecord:
        """Return what this cycle leaves. Real-time safe.

        Args:
            sample: The sample that was used.
            output: What the axis asked for.
            drive_v: Voltage that was written, in V.
            read_back_v: Voltage that the amplifier reports, in V; NaN if it does not.
        """
        return self.live.record(
            sample,
            output,
            drive_v,
            read_back_v,
            target_um=self._motion.target_um,
            on_target=self._reached,
            motion=self.motion,
        )


def _motion_limits(config: StageAxisConfig, live: CompensatedAxis, period_s: float) -> MotionLimits:
    model_um = live.zeroed_range_um
    low_um, high_um = config.command_range_um or (model_um.low, model_um.high)
    shortest_s = SHORTEST_MOTION_CYCLES * period_s
    if config.first_mode is not None:
        shortest_s = max(shortest_s, SHORTEST_MOTION_PERIODS / config.first_mode.frequency_hz)
    return MotionLimits(config.speed_um_per_s, shortest_s, low_um, high_um)


def usable(position_um: float, limits: MotionLimits) -> bool:
    """Tell whether a position may be commanded."""
    return isfinite(position_um) and limits.low_um <= position_um <= limits.high_um
