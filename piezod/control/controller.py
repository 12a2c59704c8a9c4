"""The interface of a stage to the loop process: requests in, one record per cycle out.

The controller is pure: time is an argument, and the devices are behind a boundary that turns
exceptions into values. `control.cycle` contains the cycle.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import nan
from typing import NamedTuple

from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.control.cycle import CycleParts, run_cycle
from piezod.control.faults.detection import Detection
from piezod.control.guard import Guard
from piezod.control.stage.answer import Answer
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.requests import execute
from piezod.control.stage.stage import Stage
from piezod.control.stage.user_axes import UserAxes
from piezod.control.watch.loop import CycleTiming, LoopWatch
from piezod.hysteresis.memory import FloatArray
from piezod.messages.requests import Request
from piezod.telemetry.record import CycleRecord, StageEvent
from piezod.units import NS_PER_S


class Learned(NamedTuple):
    """Learned parameters of an axis."""

    weights: FloatArray  #: (size,) weights of the identifier; they change in place.
    offset: float  #: Offset of the displacement, in units of the range.
    scale: float  #: Relative gain of the hysteresis input over the displacement.
    zero_um: float  #: Sensor zero, in µm as the sensor shows it.
    surface: bool  #: Whether the weights are the coefficients of a surface, and not those of stops.
    #: How far the learned model is from the identified one, as a share of the range; NaN without an
    #: identified one.
    distance: float
    low_um: float  #: Lowest position that may be commanded, in µm.
    high_um: float  #: Highest position that may be commanded, in µm.


class StageController:
    """Runs a stage, cycle by cycle. All methods are real-time safe."""

    def __init__(self, stage: Stage, loop_watch: LoopWatch) -> None:
        self._stage = stage
        period_s = stage.period_ns / NS_PER_S
        limits = [axis.law.limits for axis in stage.axes]
        guard = Guard(limits, period_s, stage.boundary.amplifiers)
        parts = CycleParts(stage.boundary, stage.axes, guard, period_s, stage, loop_watch)
        self.cycle: Callable[[int, CycleTiming], CycleRecord] = partial(run_cycle, parts)
        """Runs one cycle, from its instant in ns and the timing of the loop."""

    @property
    def state(self) -> State:
        """The state of the stage."""
        return self._stage.state

    @property
    def finished(self) -> bool:
        """Whether a shutdown has ended and the process may end."""
        return self._stage.state is State.STOPPING

    @property
    def users(self) -> UserAxes | None:
        """The user axes; None if there are none."""
        return self._stage.users

    @property
    def axes(self) -> list[StageAxis]:
        """The axes, in the order of the devices."""
        return self._stage.axes

    def execute(self, request: Request, t_ns: int) -> Answer:
        """Carry out a request between two cycles; return the answer."""
        stage = self._stage
        try:
            answer = execute(stage, request, t_ns)
        except Exception as error:  # noqa: BLE001 - a mistake here must not drop the voltage
            text = f"{request.kind}: {error!r}"
            stage.note(StageEvent(t_ns, "error", "crash", text, Fault.P4))
            stage.report(Detection(Fault.P4))
            answer = Answer(False, f"{request.kind} failed: {error!r}; report it, with the log")
        if not answer.accepted:
            text = f"{request.kind} refused: {answer.why}"
            stage.note(StageEvent(t_ns, "info", "refused", text))
        return answer

    def stream_um(self, axis: int, position_um: float, t_ns: int) -> None:
        """Take the newest setpoint of a stream.

        Args:
            axis: Index of the axis.
            position_um: The setpoint, in µm; a setpoint out of range is dropped.
            t_ns: Instant at which it arrived, in ns.
        """
        axes, users = self._stage.axes, self._stage.users
        if users is not None and axis >= len(axes):
            users.take_setpoint(axis - len(axes), position_um, t_ns)
            return
        target = axes[axis]
        if target.stream is None or target.follows_input:
            return
        if target.motion_limits.allow(position_um):
            target.stream.newest_um = position_um
            # One setpoint keeps the streams of all axes alive.
            for other in self._stage.axes:
                if not other.follows_input:
                    other.commanded_ns = max(other.commanded_ns, t_ns)

    def report(self, detection: Detection) -> None:
        """Take a fault that the loop process detected, for the next cycle."""
        self._stage.report(detection)

    def restore_faults(self, latched: int, *, stopped: bool) -> None:
        """Take over the latched faults of the loop that this one replaces, in BOOT.

        Args:
            latched: The faults, as a bit mask.
            stopped: Whether faults had stopped the stage.
        """
        self._stage.register.restore(latched, stopped=stopped)

    def stay_in_boot(self, stays: bool) -> None:
        """Stay in BOOT while cycles are only measured, which run faster than their period."""
        self._stage.self_test().waits = stays

    def ramp_first(self) -> None:
        """Ramp down after the self-test: the last daemon did not end in order."""
        self._stage.self_test().ramps_first = True

    def know_last_writes(self, noted_v: Sequence[float]) -> None:
        """Take over what another process has written last, in BOOT.

        Args:
            noted_v: Voltage of each axis, in V; NaN if it is not known.
        """
        self._stage.boundary.written_v = noted_v

    def forbid_entry(self, why: str) -> None:
        """Refuse to arm from now on.

        Args:
            why: The reason, for people.
        """
        self._stage.forbid_entry(why)

    def learned(self, axis: int) -> Learned:
        """Return the learned parameters of an axis."""
        moved = self._stage.axes[axis]
        law, limits = moved.law, moved.motion_limits
        return Learned(
            law.identifier.weights,
            law.identifier.offset,
            law.identifier.scale,
            self._stage.zero.um(axis),
            law.compensator.surface,
            law.bound.distance if law.bound else nan,
            limits.low_um,
            limits.high_um,
        )

    def take_events(self) -> list[StageEvent]:
        """Return the events since the last call, oldest first."""
        return self._stage.take_events()
