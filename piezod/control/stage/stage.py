"""A stage: its axes, its devices, its state, and the actions at a change of state."""

from collections.abc import Callable, Sequence
from math import nan
from typing import Final

from piezod.config.faults import Fault
from piezod.config.model_file import ModelFile
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.detection import Detection
from piezod.control.faults.register import FaultRegister
from piezod.control.stage.boundary import OutputKnowledge
from piezod.control.stage.causes import cause_of, explained
from piezod.control.stage.lines import StageLines
from piezod.control.stage.output_judge import OutputJudge
from piezod.control.stage.parts import StageParts
from piezod.control.stage.playing import StagePlay
from piezod.control.stage.self_test import SelfTest
from piezod.control.stage.sequence import DriveSequence, DriveStep
from piezod.control.stage.states import Event, Facts, HoldCause, step
from piezod.control.stage.zeroing import SensorZero
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S, s_to_ns

DRIVEN: Final = frozenset(
    {State.READY, State.RUN, State.IDENT, State.HOLD, State.RAMP, State.ESTOP}
)
"""States in which voltages are written."""
BLIND_NS: Final = s_to_ns(2.0)
"""An amplifier that does not answer keeps the others from their ramp for this time, in ns."""
_ALARMING: Final = frozenset({State.HOLD, State.BLIND, State.FAULT, State.ESTOP})
_COMPENSATING: Final = frozenset({State.READY, State.RUN, State.HOLD})


class Stage:
    """All axes of a stage in one state.

    Args:
        parts: The parts of the stage.
        register: The faults of the stage.
        memory_known: Whether the hysteresis memory is known: the stage is at rest and relaxed.
        on_output_lost: Called when the voltage in force can no longer be derived from the last
            write.

    Attributes:
        axes: The axes, in the order of the devices.
        watches: The watches of each axis.
        boundary: The devices.
        period_ns: Period of the loop, in ns.
        register: The faults.
        state: The state.
        output: Whether the voltages in force are known.
        zero: The zeros of the sensors.
        judge: Judges which voltages are in force.
        users: The user axes; None if there are none.
    """

    def __init__(
        self,
        parts: StageParts,
        register: FaultRegister,
        *,
        memory_known: bool,
        on_output_lost: Callable[[], None] | None = None,
    ) -> None:
        self.axes = [watched.axis for watched in parts.axes.values()]
        self.watches = [watched.watches for watched in parts.axes.values()]
        self.boundary, self.period_ns = parts.boundary, parts.period_ns
        self.register, self.state = register, State.BOOT
        self.output = OutputKnowledge(self.boundary.reads_back, on_output_lost)
        self.zero = SensorZero(len(self.axes), self.boundary.zero)
        self.users = parts.users and parts.users(self.axes)
        self._lines = parts.lines
        self._rebuild = parts.rebuild
        self._state_before, self._driven_when_lost, self._cause = State.BOOT, False, ""
        self._memory_known, self._was_driven = memory_known, False
        self._play = StagePlay(parts.plays, self.boundary, self.output)
        self._sequence = DriveSequence(self._play)
        self._reported, self._events = list[Detection](), list[StageEvent]()
        self._self_test, self._no_entry = SelfTest(), ""
        self._shutting_down = self._estop_pressed = False
        self._hold_cause, self._since_ns = HoldCause.FAULT, 0
        self.judge = OutputJudge(
            self.axes,
            self.watches,
            register,
            self.boundary,
            self.note,
            lambda: self._memory_known,
        )
        self._output_confirmed = False

    def go(self, event: Event, t_ns: int) -> str:
        """Take an edge of the state machine; return why it is refused, empty if it is taken.

        Real-time safe.
        """
        before = self.state
        state, refusal = step(before, event, self._facts())
        if state is not before:
            self._cause = cause_of(event, self.register.news, self._cause)
            self.state, self._since_ns = state, t_ns
            if before is not State.HOLD:
                self._state_before = before
            self._enter(state, before, t_ns)
            severity = "warning" if state in _ALARMING else "info"
            self.note(StageEvent(t_ns, severity, "state", f"{before} to {state}"))
        return explained(refusal, state, self._cause, self.time_in_state_ns(t_ns))

    def refusal(self, event: Event, t_ns: int) -> str:
        """Return why an edge would be refused, without regard to latched faults. Real-time safe.

        A request drops latched faults only if nothing else forbids it.
        """
        facts = self._facts()._replace(latched=False, no_entry=self._no_entry)
        refusal = step(self.state, event, facts).refusal
        return explained(refusal, self.state, self._cause, self.time_in_state_ns(t_ns))

    def time_in_state_ns(self, t_ns: int) -> int:
        """Return how long the stage has been in its state. Real-time safe."""
        return t_ns - self._since_ns

    def restart_hold(self, t_ns: int) -> None:
        """Restart the time in HOLD: another program drives the amplifier. Real-time safe."""
        self._since_ns = t_ns

    def self_test(self) -> SelfTest:
        """Return the self-test, which ends BOOT."""
        return self._self_test

    def end_self_test(self, t_ns: int) -> None:
        """Leave BOOT if the self-test has ended. Real-time safe.

        A voltage that last write or sensor contradict is not ramped down: it stays until a person
        looks. Where the last write agrees, the sensor is not asked: its zero is not known yet.
        """
        blocked, away = bool(self.register.blocking), self.away()
        starts_driven = self._self_test.ramps_first and away
        doubt = self.judge.doubt(ahead_s=self.period_ns / NS_PER_S) if starts_driven else ""
        event = self._self_test.end(
            at_safe=not away, blocked=blocked, output_known=self.output.known and not doubt
        )
        if event is not None and doubt:
            text = f"the voltage that was found stays: {doubt}"
            self.note(StageEvent(t_ns, "error", "output", text))
        if event is not None:
            self.go(event, t_ns)

    def forbid_entry(self, why: str) -> None:
        """Refuse to arm from now on, with this reason for people."""
        self._no_entry = why

    def hold(self, cause: HoldCause, t_ns: int) -> str:
        """Hold the voltages; return why it is refused. Real-time safe.

        In HOLD, lateness changes nothing, and any other cause takes its place.
        """
        held = self.state is State.HOLD
        if held and cause is HoldCause.LATENESS:
            return ""
        if held and self._hold_cause is HoldCause.LATENESS:
            self._hold_cause, self._since_ns = cause, t_ns
            for axis in self.axes:
                axis.hold()  # the movement will not go on by itself
            return ""
        if not held:
            self._hold_cause = cause
        return self.go(Event.HOLD if cause is HoldCause.REQUEST else Event.FAULT_HOLD, t_ns)

    def hold_cause(self) -> HoldCause:
        """Return the cause of the last HOLD. Real-time safe."""
        return self._hold_cause

    def shut_down(self, t_ns: int) -> str:
        """Go to the safe voltage and end. Real-time safe."""
        self._shutting_down = True
        return self.go(Event.SHUTDOWN, t_ns)

    def press_estop(self, t_ns: int) -> str:
        """Start an emergency stop: cut the outputs if an axis is configured so, otherwise ramp."""
        self._estop_pressed = True
        if any(axis.config.safety.estop == "cut" for axis in self.axes):
            self.cut(t_ns)
        return self.go(Event.ESTOP, t_ns)

    def release_estop(self) -> bool:
        """Release the emergency stop; return whether it was pressed. Real-time safe."""
        pressed, self._estop_pressed = self._estop_pressed, False
        return pressed

    def estop_pressed(self) -> bool:
        """Return whether the emergency stop is pressed. Real-time safe."""
        return self._estop_pressed

    def cut(self, t_ns: int) -> bool:
        """Switch the outputs of the amplifiers off; return whether they did."""
        if self.boundary.shadow or self.state not in DRIVEN | {State.BLIND}:
            return False
        self._memory_known = False
        return self.boundary.cut(t_ns)

    def drive(self, steps: Sequence[DriveStep], t_ns: int, *, conditions: bool) -> None:
        """Drive voltages in IDENT; arguments as for `DriveSequence.start`. Real-time safe."""
        self._sequence.start(self.axes, steps, t_ns, conditions=conditions)

    def continue_drive(self, t_ns: int) -> bool:
        """Continue in IDENT; return whether the memory has become known now. Real-time safe."""
        if not self._sequence.ended(self.axes, t_ns):
            return False
        becomes_known = self._sequence.makes_memory_known and not self._memory_known
        self._memory_known |= becomes_known
        self.go(Event.IDENTIFY_DONE, t_ns)
        return becomes_known

    def must_ramp(self, t_ns: int) -> bool:
        """Return whether BLIND has to end in a ramp, even without all amplifiers. Real-time safe.

        An emergency stop does not wait for them, and a stage that was driven not for long.
        """
        waited = self.time_in_state_ns(t_ns) >= BLIND_NS
        return self._estop_pressed or (self._driven_when_lost and waited)

    def play(self) -> StagePlay:
        """Return the play, which has the devices while it runs. Real-time safe."""
        return self._play

    def lines(self) -> StageLines | None:
        """Return the lines of the loop; None if there are none. Real-time safe."""
        return self._lines

    def resume_output(self, t_ns: int) -> None:
        """Begin again what the axes drive in this state: a play has left other voltages."""
        self._memory_known = False
        for watch in self.watches:
            watch.amplifier.forget()
        if self.state is not State.IDENT:
            self._enter_axes(self.state, t_ns)

    def track(self, read_back_v: Sequence[float]) -> None:
        """Follow the read-back: others may drive the outputs meanwhile. Real-time safe."""
        for axis, drive_v in zip(self.axes, read_back_v, strict=True):
            if drive_v - drive_v == 0.0:  # finite
                axis.track(drive_v)

    def confirm_output(self, *, confirmed: bool) -> None:
        """Note that a person answers for the voltage in force: that of the read-back.

        On an axis without a read-back it is the safe voltage. Where another voltage was written
        last, that is not believed: the first write would be a step.
        """
        self._output_confirmed = confirmed
        if not confirmed or self._away_unread():
            return
        self.output.know_unread(known=True)
        for i, axis in enumerate(self.axes):
            if not self.boundary.reads_back[i]:
                axis.track(axis.config.safe_v)
                self.boundary.took_over(i, axis.config.safe_v)

    def away(self) -> str:
        """Return which axes are not at their safe voltage, for people; empty if all are.

        Both the present voltage and the last write count, within the tolerance of a read-back.
        """
        in_force_v = [axis.law.in_force_v for axis in self.axes]
        return self._away_at(in_force_v, self.boundary.written_v)

    def _away_unread(self) -> str:
        """Return which axes without a read-back have another last write than the safe voltage."""
        pairs = zip(self.boundary.written_v, self.boundary.reads_back, strict=True)
        return self._away_at([nan if reads_back else drive_v for drive_v, reads_back in pairs])

    def _away_at(self, *told_v: Sequence[float]) -> str:
        """Return which axes are away by one of these voltages, in V; NaN tells nothing."""
        away = []
        for axis, *each_v in zip(self.axes, *told_v, strict=True):
            safe_v, tolerance_v = axis.config.safe_v, axis.law.limits.read_back_tolerance_v
            off_v = [drive_v for drive_v in each_v if abs(drive_v - safe_v) > tolerance_v]
            if off_v:
                away.append(f"axis {axis.name} at {off_v[0]:.4g} V instead of {safe_v:g} V")
        return ", ".join(away)

    def memory_is_missing(self) -> bool:
        """Return whether an axis compensates without a known hysteresis memory. Real-time safe."""
        return (
            not self._memory_known
            and self.state in _COMPENSATING
            and any(axis.mode is not Mode.UNCOMPENSATED for axis in self.axes)
        )

    def replace_axis(self, index: int, model: ModelFile) -> None:
        """Build an axis again with another model, while nothing is written.

        Raises:
            ModelError: If the axis cannot use the model; then nothing has changed.
        """
        old = self.axes[index]
        self.axes[index], self.watches[index] = self._rebuild(old.name, model, old.law.in_force_v)
        self._memory_known &= not self._was_driven  # the new axis has an empty memory

    def report(self, detection: Detection) -> None:
        """Take a fault that no watch detects, for the next cycle. Real-time safe."""
        self._reported.append(detection)

    def take_reports(self) -> list[Detection]:
        """Return the faults reported since the last call. Real-time safe."""
        reported, self._reported = self._reported, []
        return reported

    def note(self, event: StageEvent) -> None:
        """Store an event until it is taken. Real-time safe."""
        self._events.append(event)

    def take_events(self) -> list[StageEvent]:
        """Return the events since the last call, oldest first. Real-time safe."""
        events, self._events = self._events, []
        return events

    def _enter(self, state: State, before: State, t_ns: int) -> None:
        """Perform the actions of a new state."""
        boundary = self.boundary
        written = before in DRIVEN and not (boundary.shadow or boundary.played)
        boundary.open, boundary.withheld = state in DRIVEN, False
        boundary.returned &= boundary.open
        if not boundary.open and state is not State.BLIND:
            boundary.sent_v = None  # whoever drives the stage next begins at its voltage
        if before is State.SAFE:
            self.judge.forget()
        if state in {State.RAMP, State.ESTOP} and before not in DRIVEN:
            self._start_at_last_write()
        self._enter_axes(state, t_ns)
        # From A3 on the memory follows voltages that the output may never have had.
        self._memory_known &= not self.register.axes_of(Fault.A3)
        if state in {State.SAFE, State.FAULT, State.BLIND} and boundary.shadow:
            boundary.shadow = False
            self.output.know(known=False)  # until it is read back
            boundary.forget_written()  # others may have driven meanwhile
        if state is State.READY and not boundary.shadow:
            self._was_driven = True
        if state is State.BLIND:
            self._driven_when_lost, self._memory_known = before in DRIVEN, False
            if not written:  # what somebody else has set meanwhile is no business of ours
                boundary.forget_written()
            self.output.lose(traceable=all(boundary.reads_back) or boundary.reports_restart)
        elif state not in {State.RAMP, State.ESTOP}:
            self.output.settle()
        if before is State.IDENT:
            self._sequence.clear()

    def _enter_axes(self, state: State, t_ns: int) -> None:
        """Start what the axes drive in a new state."""
        paused = state is State.HOLD and self._hold_cause is HoldCause.LATENESS
        if paused and self._lines is not None and self._lines.busy:
            paused = False  # it cannot go on: its pulses and its edges would be lost meanwhile
            text = "late cycles end the movement, because lines are in step with it: begin it again"
            self.note(StageEvent(t_ns, "warning", "line", text))
        for axis in self.axes:
            if state is State.RUN:
                axis.rejoin(t_ns)
            elif paused:
                axis.pause()
            elif state in {State.RAMP, State.ESTOP}:
                axis.ramp_to(axis.config.safe_v)
                axis.waited_cycles = 0
            elif state is not State.IDENT:
                axis.hold()

    def _start_at_last_write(self) -> None:
        """Let a ramp start at the last write where the read-back, which was tracked, is unlike it.

        The guard then writes nothing before it is known which of them is in force. A process that
        was killed may have died between noting a voltage and writing it, one step away.
        """
        period_s = self.period_ns / NS_PER_S
        for axis, written_v in zip(self.axes, self.boundary.written_v, strict=True):
            if abs(written_v - axis.law.in_force_v) > axis.law.limits.reach_v(period_s):
                axis.law.applied(written_v)

    def _facts(self) -> Facts:
        asks = self.state is State.SAFE and not (self.boundary.shadow or self._output_confirmed)
        doubt = self.judge.doubt() if asks else ""
        return Facts(
            output_known=self.output.known,
            last_write="" if self.output.known else self._away_unread(),
            sensor_valid=self.boundary.active and all(watch.sensor.ready for watch in self.watches),
            adapt_allowed=self.register.adapt_allowed,
            model_known=self._memory_known,
            latched=bool(self.register.blocking),
            shutting_down=self._shutting_down,
            estop_active=self._estop_pressed,
            no_entry=self._no_entry or self.register.no_entry or doubt,
            was_running=self._state_before is State.RUN,
            self_tested=self._self_test.ended,
            was_driven=self._driven_when_lost,
        )
