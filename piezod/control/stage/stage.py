"""A stage: its axes, its devices, its state, and what happens on the way to another one."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from piezod.config.model_file import ModelFile
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.register import Detection, FaultRegister
from piezod.control.reference.programs import VoltageProgram
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.boundary import DeviceBoundary
from piezod.control.stage.record import StageEvent
from piezod.control.stage.states import Event, Facts, step
from piezod.control.stage.zeroing import Zeroing
from piezod.control.watch.axis import AxisWatch

DRIVEN: Final = frozenset(
    {State.READY, State.RUN, State.IDENT, State.HOLD, State.RAMP, State.ESTOP}
)
"""States in which voltages are written."""
SENSED: Final = frozenset({Mode.ADAPTIVE, Mode.TRIMMED})
"""Modes that need the sensor."""
_ALARMING: Final = frozenset({State.HOLD, State.BLIND, State.FAULT, State.ESTOP})
_NOT_HELD: Final = frozenset({State.RUN, State.IDENT, State.RAMP, State.ESTOP})


class WatchedAxis(NamedTuple):
    """An axis, and what watches it."""

    axis: StageAxis
    watches: AxisWatch


DriveStep = Mapping[int, VoltageProgram | float]
"""What is driven in IDENT at a time: axis and voltage over time, or one to ramp to."""

Rebuild = Callable[[str, ModelFile, float], WatchedAxis]
"""Makes an axis anew: its name, its model, the voltage in force."""


class Owned(NamedTuple):
    """What a stage consists of.

    Attributes:
        axes: The axes, by name.
        boundary: The devices.
        period_ns: Period of the loop.
        rebuild: Makes an axis anew with another model.
    """

    axes: Mapping[str, WatchedAxis]
    boundary: DeviceBoundary
    period_ns: int
    rebuild: Rebuild


class Stage:
    """All axes of a stage in one state.

    Args:
        owned: What it consists of.
        register: Its faults.
        memory_known: Whether the hysteresis' memory is known, the stage being at rest and relaxed.
    """

    def __init__(self, owned: Owned, register: FaultRegister, *, memory_known: bool) -> None:
        self.names = tuple(owned.axes)
        self.axes = [watched.axis for watched in owned.axes.values()]
        self.watches = [watched.watches for watched in owned.axes.values()]
        self.boundary, self.period_ns = owned.boundary, owned.period_ns
        self.rebuild = owned.rebuild
        self.register = register
        self.state, self.since_ns = State.BOOT, 0
        """The state, and since when."""
        self.memory_known = memory_known
        """Whether the hysteresis' memory is known; adapting needs it."""
        self.output_known = False
        """Whether it is known which voltages are in force."""
        self.known_when_lost = False
        """Whether it was known when the amplifier was lost."""
        self.untouched = True
        """Whether nothing has been driven yet."""
        self.silent_cycles = 0
        """For how many cycles an amplifier that reads back has not, while it is driven."""
        self.found: list[Detection] = []
        """Faults found outside of the watches, for the next cycle."""
        self.sensors_valid = False
        """Whether the last sample of every axis may be used."""
        self.adapt_allowed = True
        """Whether no fault speaks against adapting."""
        self.tested = False
        """Whether the self-test has been passed."""
        self.no_entry = ""
        """Why nothing may be armed, for people; empty where it may."""
        self.shutting_down = self.estop_pressed = False
        self.held_by_request = False
        """Whether HOLD was asked for: it lasts until it is ended."""
        self.steps: list[DriveStep] = []
        """What is still to be driven in IDENT, step by step: axis and voltage over time."""
        self.conditions = False
        """Whether what is driven in IDENT makes the memory known."""
        self.zeroing: Zeroing | None = None
        self.zero_um = [0.0] * len(self.axes)
        """Zero of each sensor, in µm as the device gives it."""
        self.stream_ns = 0
        """When the newest setpoint of a stream came."""
        self.blind_spells = 0
        """How often in a row the amplifier was lost; the next try to reach it waits the longer."""
        self.output_lost: Callable[[], None] = _nobody
        """To be told when what was written last says nothing any more of what is in force."""
        self._before, self._driven_when_lost = State.BOOT, False
        self._events: list[StageEvent] = []

    def note(self, event: StageEvent) -> None:
        """Keep something that happened until it is taken; may be called in the loop."""
        self._events.append(event)

    def take_events(self) -> list[StageEvent]:
        """Return what has happened since the last call, oldest first; may be called in the loop."""
        events, self._events = self._events, []
        return events

    def go(self, event: Event, t_ns: int) -> str:
        """Take an edge; return why not, empty where it is taken; may be called in the loop."""
        before = self.state
        state, refusal = step(before, event, self._facts())
        if state is not before:
            self.state, self.since_ns = state, t_ns
            if before is not State.HOLD:
                self._before = before
            self._enter(state, before, t_ns)
            severity = "warning" if state in _ALARMING else "info"
            self.note(StageEvent(t_ns, severity, "state", f"{before} to {state}"))
        return refusal

    def refusal(self, event: Event) -> str:
        """Return why an edge would be refused whatever is latched; call it in the loop.

        A latch is dropped only by a request that is not refused for another reason.
        """
        facts = self._facts()._replace(latched=False, no_entry=self.no_entry)
        return step(self.state, event, facts).refusal

    def drive(self, steps: Sequence[DriveStep], t_ns: int, *, conditions: bool) -> None:
        """Begin to drive voltages, step by step; in IDENT; may be called in the loop.

        Args:
            steps: One after the other; axes that a step does not name hold.
            t_ns: Now.
            conditions: Whether the memory is known at the end.
        """
        self.steps, self.conditions = list(steps), conditions
        self.next_step(t_ns)

    def next_step(self, t_ns: int) -> bool:
        """Begin the next step of what is driven; return whether there was one."""
        if not self.steps:
            return False
        step_now = self.steps.pop(0)
        for i, axis in enumerate(self.axes):
            match step_now.get(i):
                case None:
                    axis.hold()
                case VoltageProgram() as drive:
                    axis.drive(drive, t_ns)
                case voltage:
                    axis.ramp_to(voltage)
        return True

    def replace_axis(self, index: int, model: ModelFile) -> None:
        """Make an axis anew, with another model; while nothing is written.

        Raises:
            ModelError: If the axis cannot use it; nothing has changed then.
        """
        in_force_v = self.axes[index].live.in_force_v
        self.memory_known = self.memory_known and self.untouched  # the new one remembers nothing
        self.axes[index], self.watches[index] = self.rebuild(self.names[index], model, in_force_v)

    def set_zero(self, index: int, zero_um: float) -> None:
        """Count the displacement of an axis from another reading of its sensor on.

        May be called in the loop.
        """
        self.zero_um[index] = zero_um
        self.boundary.zero(self.zero_um)

    def cut(self, t_ns: int) -> bool:
        """Have the amplifiers switch their outputs off; return whether they did."""
        if self.boundary.shadow or self.state not in DRIVEN | {State.BLIND}:
            return False
        self.memory_known = False
        return self.boundary.cut(t_ns)

    def _enter(self, state: State, before: State, t_ns: int) -> None:
        self.boundary.open = state in DRIVEN
        self.boundary.withheld = self.held_by_request = False
        if state is State.RUN:
            for axis in self.axes:
                axis.stay(t_ns)
        elif state in {State.RAMP, State.ESTOP}:
            for i, axis in enumerate(self.axes):
                self._begin_where_it_is(i)
                axis.ramp_to(axis.config.safe_v)
        elif state not in _NOT_HELD:
            for axis in self.axes:
                axis.hold()
        if state in {State.SAFE, State.FAULT, State.BLIND} and self.boundary.shadow:
            self.boundary.shadow = self.output_known = False  # until it is read back
        if state is State.READY and not self.boundary.shadow:
            self.untouched = False
        if state is State.BLIND:
            self.known_when_lost, self.output_known = self.output_known, False
            self._driven_when_lost = before in DRIVEN
            self.memory_known = False
            self.blind_spells += 1
            if not (self.boundary.reads_back or self.boundary.tells_restart):
                self.output_lost()
        elif state not in {State.RAMP, State.ESTOP}:
            self.blind_spells = 0
        if before is State.IDENT:
            self.steps.clear()

    def _begin_where_it_is(self, index: int) -> None:
        """Have the way to the safe voltage begin where the output has fallen to by itself.

        What is read back farther away from the safe voltage is not taken over: no way down may
        begin with a step up, and a single answer may be wrong.
        """
        axis, strayed_v = self.axes[index], self.watches[index].amplifier.strayed_v
        safe_v = axis.config.safe_v
        if abs(strayed_v - safe_v) < abs(axis.live.in_force_v - safe_v):  # not where it is NaN
            axis.track(strayed_v)
            self.boundary.forget_sent(index)

    def _facts(self) -> Facts:
        return Facts(
            output_known=self.output_known,
            sensor_valid=self.sensors_valid,
            adapt_allowed=self.adapt_allowed,
            model_known=self.memory_known,
            latched=bool(self.register.blocking),
            resumable=True,  # whoever asks has asked the register first
            shutting_down=self.shutting_down,
            estop_active=self.estop_pressed,
            no_entry=self.no_entry or self.register.no_entry,
            was_running=self._before is State.RUN,
            self_tested=self.tested,
            was_driven=self._driven_when_lost,
        )


def _nobody() -> None:
    """Tell nobody."""
