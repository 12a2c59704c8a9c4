"""A stage in virtual time that clients command through the service, with all that must always hold.

Requests take the way of the daemon behind the HTTP parser: the lease, the handler in the loop, the
answer. Each cycle and each request is checked at once, so that a failure shows where it began.
"""

from collections.abc import Callable, Coroutine
from math import isfinite
from typing import Any, Final, cast

from piezod.config.states import State
from piezod.control.guard import Limits
from piezod.control.in_force import OUTPUT_WAIT_S
from piezod.control.law.axis import AxisOutput
from piezod.control.stage.answer import Answer
from piezod.control.stage.stage import DRIVEN
from piezod.control.stage.states import HoldCause
from piezod.control.watch.loop import CycleTiming
from piezod.daemon.service.access import LeaseKeeper, Roles, UrgentNotes
from piezod.daemon.service.answers import LeaseHeldError
from piezod.daemon.service.request import OpenStreams, RequestContext, ServiceState
from piezod.daemon.stage.errors import StageError
from piezod.daemon.stage.peer import Peer
from piezod.daemon.stage.running_stage import RunningStage
from piezod.devices.interface import Sample
from piezod.devices.status import DeviceFlag
from piezod.messages import requests as rq
from piezod.messages.answers import Faults
from piezod.messages.endpoints import Role
from piezod.telemetry.record import CycleRecord
from piezod.testing.injections import InjectionKind
from piezod.units import NS_PER_S
from tests.control.judged_device import JudgedDevice
from tests.control.own_output import OutputFault, OutputKind
from tests.control.rig_stage import ON_TIME, FaultyStage, quick_config
from tests.control.surface_rig import with_model

ARMED: Final = frozenset({State.READY, State.RUN, State.IDENT})
PEOPLE: Final = tuple(Peer(uid, uid, f"user{uid}", "", Role.ENGINEER) for uid in (1, 2))
WAY_DOWN: Final[dict[State, rq.Request]] = {
    **dict.fromkeys((*ARMED, State.HOLD), rq.Stop()),
    State.FAULT: rq.Reset(engineer=True),
    State.SAFE: rq.Arm(),
}
MOVED: Final = frozenset({DeviceFlag.LOCAL_MODE, DeviceFlag.RESTARTED, DeviceFlag.WATCHDOG_TRIPPED})
"""Flags of an amplifier whose output need not be at the last write any more."""
LOCAL_CYCLES: Final = 8
"""Cycles in local mode, within which the output settles."""
NOISE_V: Final = 0.005
"""Noise of the read-back, at most, in V."""
WITHIN_S: Final = OUTPUT_WAIT_S + 20.0
"""Two ramps, the second that a fault must be gone, and the time after which a HOLD or a ramp fails,
in s."""


class CommandedStage(FaultyStage):
    """A stage of one axis with two people, a lease and an amplifier that may fail."""

    def __init__(self, model: str = "stops") -> None:
        config = with_model(quick_config(), model)
        limits = config.axes["x"].limits
        self._range_v = limits.drive_min_v, limits.drive_max_v
        period_ns = round(NS_PER_S / config.rate_hz)
        of_drive = Limits(limits.drive_min_v, limits.drive_max_v, limits.slew_v_per_s)
        super().__init__(config, faulty=lambda inner: JudgedDevice(inner, of_drive, period_ns))
        assert isinstance(self.device, JudgedDevice)
        self.judged = self.device
        """The rig, whose output may fail."""
        self.judged.stage = self.stage
        self._step_v = limits.slew_v_per_s / self.config.rate_hz * (1.0 + 1e-12)
        self.moves_freshly = True
        """Whether voltages are planned for their cycle; others must not move anything."""
        self._taken_over = False
        """Whether a new loop runs its first cycle: it does not know the last write."""
        now_s: Callable[[], float] = lambda: self.t_ns / NS_PER_S  # noqa: E731 - a clock
        self.lease = LeaseKeeper(now_s)
        self._service = ServiceState(
            cast("RunningStage", _Service(self)),
            cast("Roles", None),  # who may send what is checked before the context is made
            self.lease,
            set(),
            UrgentNotes(now_s),
            OpenStreams(),
            {},
        )

    def command(self, person: Peer, request: rq.Request) -> bool:
        """Send a request of a person; check its effect; return whether it was accepted."""
        before, row = self.controller.state, rq.TABLE[request.kind]
        # A fault that was latched in SAFE leads to FAULT at the next event of any kind.
        blocked = before is State.SAFE and bool(self.stage.register.blocking)
        holder = self.lease.present
        mine = holder is None or holder.holder.uid == person.uid
        try:
            _finished(RequestContext(self._service, person, row.access).ask(request))
        except StageError as error:
            assert isinstance(error, LeaseHeldError) == (row.access.lease and not mine)
            assert self.controller.state is before, f"{request.kind} was refused"
            return False
        after = self.controller.state
        assert mine or not row.access.lease
        assert (
            after in {before, State.BLIND} | DRIVEN - ARMED
            or row.access.lease
            or after is State.STOPPING
            or (blocked and after is State.FAULT)
        )
        assert after not in ARMED or after is before or self._mine_now(person)
        return True

    def cycle(self, timing: CycleTiming = ON_TIME) -> CycleRecord:
        """Run one cycle, and check it."""
        first, before = len(self.channels.writes), self.controller.state
        goes_on = self.stage.hold_cause() is HoldCause.LATENESS and before is State.HOLD
        t_ns = self.t_ns + self.period_ns * (1 + timing.skipped)
        output_v = self.judged.output.output_v(t_ns)
        record = super().cycle(timing)
        after = State(record.state)
        if after in ARMED and after is not before:
            by_itself = before is State.IDENT and after is State.READY
            assert by_itself or (goes_on and not self.stage.register.needs_person), (before, after)
        writes = self.channels.writes[first:]
        assert [t_ns for t_ns, _ in writes] == [self.t_ns] * len(writes), "a write is of its cycle"
        assert len(writes) <= int(after in DRIVEN and not record.shadow)
        for _, (drive_v,) in writes:
            self._check_voltage(drive_v, first, output_v)
        assert not self.judged.violations, self.judged.violations
        return record

    def fail_output(self, kind: OutputKind, cycles: int, value: float) -> None:
        """Let the output or its read-back fail from the next cycle on."""
        start_ns = self.t_ns + 1
        end_ns = start_ns + cycles * self.period_ns
        self.judged.output.faults.append(OutputFault(kind, start_ns, end_ns, value))

    def run_broken_law(self, drive_v: float, early_ns: int, cycles: int) -> None:
        """Run cycles in which the control law asks for this voltage, planned too early."""
        law = self.stage.axes[0].law
        update = law.update

        def broken(t_ns: int, sample: Sample) -> AxisOutput:
            output: AxisOutput = update(t_ns, sample)
            output.drive_v, output.t_ns = drive_v, t_ns - early_ns
            return output

        law.update = broken  # type: ignore[method-assign] # the mistake under test
        self.moves_freshly = not early_ns
        for _ in range(cycles):
            self.cycle()
        law.update, self.moves_freshly = update, True  # type: ignore[method-assign] # as it was

    def disturb_output(self, drive_v: float, flag: DeviceFlag) -> None:
        """Change the output while nothing is written, and let the amplifier report why.

        In local mode somebody turns the knob to a voltage; with any other flag the output falls to
        0 V.
        """
        local = flag is DeviceFlag.LOCAL_MODE
        self.fail(InjectionKind.FLAGGED, LOCAL_CYCLES if local else 1, flag=flag)
        if local:
            self.cycle()
        if not local or self.stage.boundary.withheld or self.controller.state not in DRIVEN:
            self.device.inner.write([drive_v if local else 0.0], self.t_ns)
        for _ in range(LOCAL_CYCLES):
            self.cycle()

    def restart(self) -> None:
        """Let a new loop take over from one that was killed, 50 ms later."""
        self.t_ns += NS_PER_S // 20
        self.kill_loop()
        self.judged.stage, self._taken_over = self.stage, True
        self.judged.forget()
        self.cycle()
        self._taken_over = False
        assert self.controller.state not in ARMED

    def recover(self) -> None:
        """Reach the safe voltage as a person does, when nothing fails any more.

        In SAFE the output may be elsewhere, because it came back by itself: arm and stop bring it
        down. Where the witnesses contradict each other, the person has looked at the amplifier and
        answers for its read-back, which is right by now. In STOPPING the loop ends.
        """
        self.device.schedule.clear()
        self.judged.output.faults.clear()
        end_ns = self.t_ns + WITHIN_S * NS_PER_S
        while not self._is_down:
            assert self.t_ns < end_ns, f"still in {self.state} with {self.stage.register.no_entry}"
            if request := WAY_DOWN.get(self.controller.state):
                answer = self.controller.execute(request, self.t_ns)
                if not answer.accepted and isinstance(request, rq.Arm):
                    self.controller.execute(rq.Arm(confirm_output=True), self.t_ns)
            for _ in range(20):
                self.cycle()

    @property
    def _is_down(self) -> bool:
        """Whether the loop ends, or the stage is in SAFE and at its safe voltage."""
        off_v = self.judged.output.output_v(self.t_ns) - self.config.axes["x"].safe_v
        at_rest = self.controller.state is State.SAFE and abs(off_v) <= self.judged.bound_v
        return at_rest or self.controller.state is State.STOPPING

    def _check_voltage(self, drive_v: float, first: int, output_v: float) -> None:
        """Check a voltage against the range, and against the one of the cycle before.

        The rig judges whether it is near the output.
        `first` is the number of writes before it.
        """
        assert isfinite(drive_v)
        before_ns, (before_v,) = self.channels.writes[first - 1] if first else (-1, (output_v,))
        shown_v = self.judged.shown_v if isfinite(self.judged.shown_v) else output_v
        # An output that is found outside the range returns at the slew rate, and goes no farther.
        found_v = output_v, before_v, shown_v
        # A new loop begins at the read-back of its first cycle.
        assert self._outside_v(drive_v) <= max(NOISE_V, *map(self._outside_v, found_v))
        follows = len(self.records) > 1 and before_ns == self.records[-2].t_ns
        if follows and not self._taken_over:
            # A write that was not taken is not in force: the one before it is kept.
            moves = self.moves_freshly or not self.records[-2].written
            step_v = abs(drive_v - before_v)
            taken_over = abs(drive_v - output_v) <= self.judged.bound_v and moves
            assert taken_over or step_v <= (self._step_v if moves else 0.0)

    def _outside_v(self, drive_v: float) -> float:
        """Return how far a voltage is outside the range, in V."""
        low_v, high_v = self._range_v
        return max(low_v - drive_v, drive_v - high_v, 0.0)

    def _mine_now(self, person: Peer) -> bool:
        holder = self.lease.present
        return holder is not None and holder.holder.uid == person.uid


class _Service:
    """The part of a stage service that requests to the loop need."""

    def __init__(self, stage: CommandedStage) -> None:
        self._stage, self.axes = stage, tuple(stage.config.axes)

    @property
    def state(self) -> str:
        return self._stage.state

    async def request(self, request: rq.Request, peer: Peer) -> Answer:  # noqa: ARG002 - a protocol
        return self._stage.controller.execute(request, self._stage.t_ns)

    def faults(self) -> Faults:
        return Faults(faults=())

    def audit(self, entry: object) -> None:
        """Keep nothing."""


def _finished(work: Coroutine[Any, Any, Answer]) -> Answer:
    """Run a coroutine that waits for nothing."""
    try:
        work.send(None)
    except StopIteration as end:
        return cast("Answer", end.value)
    raise AssertionError("a request to a stage in virtual time waits")
