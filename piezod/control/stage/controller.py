"""What the loop runs: requests come in, each cycle answers what to write, faults decide first.

The controller is pure: time is an argument, the devices are behind a boundary that turns what they
raise into values. What happens in a cycle is in `cycle` and `watch`, in this order: read, judge the
samples, react to faults, go on with what each axis does, compensate, guard, write.
"""

from collections.abc import Sequence
from math import nan
from typing import NamedTuple

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.requests import Request
from piezod.config.states import State
from piezod.control.cycle import Cycle, CycleRecord
from piezod.control.faults.register import Detection, News
from piezod.control.faults.table import Reaction, mask
from piezod.control.guard import Guard
from piezod.control.stage.axis import usable
from piezod.control.stage.progress import go_on
from piezod.control.stage.record import Answer, StageEvent, StageRecord
from piezod.control.stage.requests import execute
from piezod.control.stage.stage import DRIVEN, SENSED, Stage
from piezod.control.stage.states import Event
from piezod.control.stage.watches import StageWatches, crashed
from piezod.control.watch.loop import CycleTiming
from piezod.devices.interface import Sample
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S

LONGEST_CYCLES = 2
"""So many periods count for the slew rate after a pause, however long it was."""

_OVERLOADED, _OSCILLATES = mask([Fault.A4]), mask([Fault.D6])
_EVENTS = {
    Reaction.HOLD: Event.FAULT_HOLD,
    Reaction.RAMP: Event.FAULT_RAMP,
    Reaction.BLIND: Event.FAULT_BLIND,
    Reaction.CUT: Event.FAULT_CUT,
}


class Learned(NamedTuple):
    """What an axis has learned.

    Attributes:
        weights: (2 M,) weights [a^l, a^r] of the identifier; they change in place.
        offset: Drift of the displacement, in units of the range.
        scale: By how much more than the displacement the hysteresis sees.
        zero_um: Sensor zero, in µm as the device gives it.
    """

    weights: FloatArray
    offset: float
    scale: float
    zero_um: float


class StageController:
    """Runs a stage, cycle by cycle.

    Args:
        stage: The stage.
    """

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self._watches = StageWatches(stage)
        period_s = stage.period_ns / NS_PER_S
        guard = Guard([axis.live.limits for axis in stage.axes], LONGEST_CYCLES * period_s)
        self._cycle = Cycle(stage.boundary, stage.boundary, stage.axes, guard, period_s, self)
        self._eased_axes = 0
        self._timing = CycleTiming(0, 0, 0, 0, 0)
        self._read_back_v: Sequence[float] = [nan] * len(stage.axes)

    @property
    def state(self) -> State:
        """The state of the stage."""
        return self.stage.state

    @property
    def finished(self) -> bool:
        """Whether a shutdown is done and the process may end."""
        return self.stage.state is State.STOPPING

    def execute(self, request: Request, t_ns: int) -> Answer:
        """Carry out a request, or say why not; may be called in the loop, between cycles."""
        try:
            answer = execute(self.stage, request, t_ns)
        except Exception as error:  # noqa: BLE001 - a mistake in here must not drop the voltage
            self.stage.found.append(
                crashed(self.stage, t_ns, Fault.P4, -1, f"{request.kind}: {error!r}")
            )
            answer = Answer(False, f"{request.kind} failed: {error!r}; report it, with the log")
        if not answer.accepted:
            text = f"{request.kind} refused: {answer.why}"
            self.stage.note(StageEvent(t_ns, "info", "refused", text))
        return answer

    def stream_um(self, axis: int, position_um: float, t_ns: int) -> None:
        """Take the newest setpoint of a stream; may be called in the loop.

        Args:
            axis: Index of the axis.
            position_um: The setpoint; one that is not usable counts as none.
            t_ns: Instant at which it came.
        """
        one = self.stage.axes[axis]
        if one.stream is not None and not one.follows_input and usable(position_um, one.pace):
            one.stream.newest_um = position_um
            self.stage.stream_ns = max(self.stage.stream_ns, t_ns)

    def found(self, detection: Detection) -> None:
        """Take a fault that the loop process found, for the next cycle; call it in the loop."""
        self.stage.found.append(detection)

    def learned(self, axis: int) -> Learned:
        """Return what an axis has learned; may be called in the loop."""
        identifier = self.stage.axes[axis].live.identifier
        zero_um = self.stage.zero_um[axis]
        return Learned(identifier.weights, identifier.offset, identifier.scale, zero_um)

    def take_events(self) -> list[StageEvent]:
        """Return what has happened since the last call, oldest first; may be called in the loop."""
        return self.stage.take_events()

    def cycle(self, t_ns: int, timing: CycleTiming) -> StageRecord:
        """Run one cycle; a fault is a value; may be called in the loop.

        Args:
            t_ns: Instant of the cycle.
            timing: How punctual the loop is.
        """
        self._timing = timing
        for axis in self.stage.axes:
            axis.live.identifier.gate.skipped = timing.skipped > 0
        stage, record = self.stage, self._cycle.run(t_ns)
        admitted_v, read_back_v = record.admitted.drive_v, self._read_back_v
        driven = stage.state in DRIVEN
        if driven:
            self._learn_of_write(record)
        axes = [
            axis.record(record.samples[i], record.outputs[i], admitted_v[i], read_back_v[i])
            for i, axis in enumerate(stage.axes)
        ]
        register, shadow = stage.register, stage.boundary.shadow
        written = record.written or not driven
        return StageRecord(
            t_ns, stage.state, shadow, written, register.present, register.latched, axes
        )

    @property
    def sent_v(self) -> Sequence[float] | None:
        """What was sent last and not acknowledged, in V; None where nothing was."""
        return self.stage.boundary.sent_v

    @property
    def eased(self) -> Sequence[int]:
        """Axes whose amplifier is overloaded: they may go only half as fast as usual."""
        if not self.stage.register.present & _OVERLOADED:
            return ()
        return [i for i, one in enumerate(self.stage.watches) if one.amplifier.overloaded]

    def watch(self, t_ns: int, samples: Sequence[Sample]) -> Sequence[Sample]:
        """Judge what was read, react to faults, go on; return the samples to use.

        The cycle calls it between reading and compensating; may be called in the loop.
        """
        try:
            return self._judge(t_ns, samples)
        except Exception as error:  # noqa: BLE001 - a mistake in here must not drop the voltage
            text = f"judging failed: {error!r}"
            self.stage.found.append(crashed(self.stage, t_ns, Fault.P4, -1, text))
            for axis in self.stage.axes:
                axis.hold()
            return [Sample(sample.t_ns, nan, False) for sample in samples]

    def _judge(self, t_ns: int, samples: Sequence[Sample]) -> Sequence[Sample]:
        stage = self.stage
        read_back_v = stage.boundary.read_back(t_ns)
        shadow = stage.boundary.shadow  # what is in force says nothing then of what is asked for
        self._read_back_v = [nan] * len(stage.axes) if shadow else read_back_v
        found = self._watches.check(t_ns, samples, self._read_back_v, self._timing)
        reaction = stage.register.update(found, t_ns)
        for news in stage.register.news:
            if news.rule.reaction is not Reaction.NONE:  # else it is shown, and would flood the log
                stage.note(self._told(t_ns, news))
        stage.adapt_allowed = stage.register.adapt_allowed
        self._ease()
        self._react(reaction, t_ns)
        usable = [
            watches.sensor.sample if stage.boundary.active else sample
            for watches, sample in zip(stage.watches, samples, strict=True)
        ]
        stage.sensors_valid = all(sample.valid for sample in usable)
        go_on(stage, t_ns, usable, self._read_back_v)
        return usable

    def _react(self, reaction: Reaction, t_ns: int) -> None:
        stage = self.stage
        if reaction in {Reaction.DEGRADE, Reaction.HOLD} or not stage.adapt_allowed:
            for axis in stage.axes:
                if axis.mode in SENSED:
                    axis.select(Mode.FEEDFORWARD)
        event = _EVENTS.get(reaction)
        if event is Event.FAULT_CUT and not stage.cut(t_ns):
            event = Event.FAULT_RAMP
        if event is not None:
            stage.go(event, t_ns)
            if event is Event.FAULT_BLIND:
                self._forget()

    def _ease(self) -> None:
        """Halve the gains of the axes that oscillate, until that is reset."""
        register = self.stage.register
        eased = (
            register.axes_of(Fault.D6) if (register.present | register.latched) & _OSCILLATES else 0
        )
        if eased != self._eased_axes:
            self._eased_axes = eased
            for i, axis in enumerate(self.stage.axes):
                axis.live.ease(bool(eased >> i & 1))

    def _forget(self) -> None:
        for watches in self.stage.watches:
            watches.amplifier.forget()

    def _learn_of_write(self, record: CycleRecord) -> None:
        if self.stage.boundary.shadow or self.stage.boundary.withheld:
            return
        admitted = record.admitted
        for i, (axis, watches) in enumerate(zip(self.stage.axes, self.stage.watches, strict=True)):
            cut_off = axis.following and axis.live.compensator.limited
            at_end = axis.live.at_end_of_range
            watches.amplifier.wrote(
                admitted.drive_v[i],
                taken=record.written,
                refused=i in admitted.refused,
                range_limited=i in admitted.range_limited or (cut_off and at_end),
                slew_limited=i in admitted.slew_limited or (cut_off and not at_end),
            )

    def _told(self, t_ns: int, news: News) -> StageEvent:
        rule, detection, appeared = news
        axis = self.stage.names[detection.axis] if detection.axis >= 0 else ""
        text = f"{rule.name}; {rule.remedy}" if appeared else f"{rule.name}: gone"
        return StageEvent(
            t_ns,
            rule.severity if appeared else "info",
            "fault" if appeared else "fault-cleared",
            text,
            rule.id,
            axis,
            detection.measured,
            detection.limit,
        )
