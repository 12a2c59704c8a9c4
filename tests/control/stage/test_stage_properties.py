"""Properties of a stage for any requests, faults, stalls and restarts, in any order."""

from math import inf, nan
from typing import Final

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Sine, Triangle
from piezod.control.watch.loop import CycleTiming
from piezod.daemon.stage.peer import Peer
from piezod.devices.status import DeviceFlag
from piezod.messages import requests as rq
from piezod.testing.injections import InjectionKind as Kind
from tests.control.own_output import OutputKind
from tests.control.rig_stage import ON_TIME
from tests.control.stage.commanded_stage import MOVED, PEOPLE, WITHIN_S, CommandedStage
from tests.control.surface_rig import VARIANTS

REQUESTS: Final[list[rq.Request]] = [
    rq.Arm(),
    rq.Arm(),
    rq.Arm(shadow=True),
    rq.Disarm(),
    *(rq.SelectMode(mode=mode) for mode in Mode),
    rq.Goto(position_um=0.0),
    rq.Goto(position_um=12.0),
    rq.Goto(position_um=25.0, speed_um_per_s=1e6),
    rq.Goto(position_um=-1.0),
    rq.Wave(command_um={"x": Sine(kind="sine", low=0, high=25, frequency_hz=9)}, duration_s=1),
    rq.Stream(axes=("x",)),
    rq.Hold(),
    rq.Resume(),
    rq.Stop(),
    rq.Estop(),
    rq.Reset(),
    rq.Reset(engineer=True),
    rq.Condition(),
    rq.Zero(),
    rq.Identify(
        drive_v={"x": Triangle(kind="triangle", low=50, high=150, frequency_hz=5)}, duration_s=0.2
    ),
]
HOUR_NS = 3600 * 10**9
TIMINGS: Final = [
    ON_TIME,
    CycleTiming(4_500_000, 3, 8_000_000, 0, 0),
    CycleTiming(0, 60, 10_000, 0, 0),
    CycleTiming(0, 500, 10_000, 0, 0),
    CycleTiming(0, 0, 10_000, 0, HOUR_NS),  # the machine slept, and its monotonic clock, too
    CycleTiming(0, 0, 10_000, -HOUR_NS, 0),  # somebody set the clock
    CycleTiming(0, 0, 10_000, HOUR_NS, 0),
]
SIZES: Final = (nan, inf, -inf, 1e9, -1.0, 0.5, 30.0)
OF_OUTPUT: Final = {Kind.STUCK_OUTPUT, Kind.READ_BACK_OFFSET}
"""Faults that `OutputKind` has, too."""
OUTPUT_VALUES: Final = {
    OutputKind.SCALED: (0.5, 1.5),
    OutputKind.LATE: (0.01, 0.5),
    OutputKind.SLOW: (0.01, 0.5),
    OutputKind.ELSEWHERE: (0.0, 150.0),
    OutputKind.FALSE_READ_BACK: (0.0, 150.0),
    OutputKind.SHIFTED_READ_BACK: (-30.0, 30.0),
    OutputKind.SCALED_READ_BACK: (0.5, 1.5),
    OutputKind.LATE_READ_BACK: (0.01, 0.5),
}
"""Smallest and largest value of each kind that has one."""
SETPOINTS_UM: Final = st.floats(0.0, 30.0) | st.sampled_from([nan, inf, -1.0])


class AnyHistory(RuleBasedStateMachine):
    """What may happen to a stage with any model; `CommandedStage` checks each step."""

    @rule(person=st.sampled_from(PEOPLE), request=st.sampled_from(REQUESTS))
    def command(self, person: Peer, request: rq.Request) -> None:
        """Somebody sends a request."""
        self.stage.command(person, request)
        self.stage.cycle()

    @initialize(
        model=st.sampled_from(list(VARIANTS)),
        mode=st.sampled_from([None, *Mode]),
        position_um=st.floats(0.0, 25.0),
    )
    def start(self, model: str, mode: Mode | None, position_um: float) -> None:
        """Somebody moves the stage, in four cases of five."""
        self.stage, self.restarts = CommandedStage(model), 0
        self.stage.cycle()
        if mode is not None:
            for request in (rq.Arm(), rq.SelectMode(mode=mode), rq.Goto(position_um=position_um)):
                self.command(PEOPLE[0], request)

    @rule(cycles=st.integers(1, 60), setpoint_um=SETPOINTS_UM)
    def go_on(self, cycles: int, setpoint_um: float) -> None:
        """Time passes, with setpoints in each cycle."""
        for _ in range(cycles):
            self.stage.controller.stream_um(0, setpoint_um, self.stage.t_ns)
            self.stage.cycle()

    @rule(timing=st.sampled_from(TIMINGS), cycles=st.integers(1, 5))
    def stall(self, timing: CycleTiming, cycles: int) -> None:
        """The loop is late, or a clock jumps."""
        for _ in range(cycles):
            self.stage.cycle(timing)

    @rule(
        kind=st.sampled_from([kind for kind in Kind if kind not in OF_OUTPUT]),
        cycles=st.sampled_from([1, 4, 30, 300]),
        value=st.sampled_from(SIZES),
        flag=st.sampled_from(DeviceFlag),
    )
    def fail(self, kind: Kind, cycles: int, value: float, flag: DeviceFlag) -> None:
        """The device fails for a while."""
        size = abs(value) * 1e6 if kind is Kind.LATE and abs(value) < inf else value
        if kind is Kind.LATE and not abs(size) < inf:
            size = 0.0
        self.stage.fail(kind, cycles, value=size, flag=flag)
        for _ in range(min(cycles, 20)):
            self.stage.cycle()

    @rule(
        kind=st.sampled_from(OutputKind),
        cycles=st.sampled_from([1, 4, 30, 300, 3000]),
        share=st.floats(0.0, 1.0),
        then=st.sampled_from([0, 20, 400]),
    )
    def fail_output(self, kind: OutputKind, cycles: int, share: float, then: int) -> None:
        """The output or its read-back is not at the last write for a while."""
        low, high = OUTPUT_VALUES.get(kind, (0.0, 0.0))
        self.stage.fail_output(kind, cycles, low + share * (high - low))
        for _ in range(then):
            self.stage.cycle()

    @rule(person=st.sampled_from(PEOPLE))
    def start_again(self, person: Peer) -> None:
        """Somebody waits for the end of a stop, resets the faults and arms."""
        for request in (rq.Stop(), rq.Reset(engineer=True), rq.Arm()):
            self.command(person, request)
            self.stage.run(3.0 if request.kind == "stop" else 0.1)

    @rule(drive_v=st.floats(), early_ns=st.sampled_from([0, 0, 1]), cycles=st.integers(1, 20))
    def miscalculate(self, drive_v: float, early_ns: int, cycles: int) -> None:
        """The control law asks for any voltage, or for one that belongs to another instant."""
        self.stage.run_broken_law(drive_v, early_ns, cycles)

    @rule(drive_v=st.floats(0.0, 150.0), flag=st.sampled_from(sorted(MOVED)))
    def disturb_output(self, drive_v: float, flag: DeviceFlag) -> None:
        """Somebody turns the knob of the amplifier in local mode, or its output falls."""
        self.stage.disturb_output(drive_v, flag)

    @precondition(lambda self: self.restarts < 3)
    @rule()
    def restart(self) -> None:
        """The loop process is killed, and another one takes over."""
        self.restarts += 1
        self.stage.restart()

    @precondition(lambda self: self.restarts < 3)
    @rule()
    def shut_down(self) -> None:
        """The daemon ends; the next one starts."""
        self.stage.command(PEOPLE[1], rq.Shutdown())
        self.stage.device.schedule.clear()
        self.stage.judged.output.faults.clear()
        self.stage.until("STOPPING", WITHIN_S)
        self.restart()

    def teardown(self) -> None:
        """Whatever has happened, a person gets the stage back to SAFE and its safe voltage."""
        self.stage.recover()


def check(steps: int) -> None:
    """Run the machine, with the number of examples of the profile."""
    few = settings(
        stateful_step_count=steps,
        suppress_health_check=[HealthCheck.too_slow],
        # To explain a history takes longer than a test may: the shortest one explains itself.
        phases=[phase for phase in Phase if phase is not Phase.explain],
    )
    run_state_machine_as_test(AnyHistory, settings=few)


def test_no_history_breaks_a_limit() -> None:
    """Voltages are finite, in range, of their cycle, near the one before, and asked for."""
    check(15)


def test_read_back_that_is_right_again_is_waited_for() -> None:
    """It was false while the output was stuck: the ramp has gone on without a right witness."""
    history = AnyHistory()
    history.start(model="stops", mode=Mode.UNCOMPENSATED, position_um=5.0)
    history.fail_output(cycles=1, kind=OutputKind.STUCK, share=0.0, then=20)
    history.fail_output(cycles=30, kind=OutputKind.STUCK, share=0.0, then=0)
    history.fail_output(cycles=30, kind=OutputKind.FALSE_READ_BACK, share=0.0, then=400)
    history.teardown()


def test_new_loop_begins_at_the_output() -> None:
    """If the last writes before were refused, the new loop goes on from what it reads back."""
    stage = CommandedStage()
    stage.cycle()
    for request in (rq.Arm(), rq.Goto(position_um=12.0)):
        assert stage.command(PEOPLE[0], request)
        stage.cycle()
    stage.fail(Kind.REFUSED, 4, flag=DeviceFlag.OVERLOAD)
    for _ in range(4):
        stage.cycle()
    output_v = stage.judged.output.output_v(stage.t_ns)

    stage.restart()

    assert stage.x.drive_v == pytest.approx(output_v, abs=1.1)


def test_new_loop_leaves_an_output_whose_read_back_the_sensor_contradicts() -> None:
    """What it read back may be false: a ramp that begins there would be a step."""
    stage = CommandedStage()
    stage.cycle()
    stage.fail_output(OutputKind.FALSE_READ_BACK, 300, 150.0)

    stage.restart()
    for _ in range(20):
        stage.cycle()

    assert stage.controller.state is State.FAULT
    assert not stage.command(PEOPLE[0], rq.Arm())


@pytest.mark.parametrize("request_", [rq.Hold(), rq.Stop()])
def test_voltage_of_another_cycle_moves_nothing(request_: rq.Request) -> None:
    """Whether the stage follows a command or drives voltages itself: they keep their instant."""
    stage = CommandedStage()
    stage.cycle()
    for request in (rq.Arm(), rq.Goto(position_um=12.0)):
        assert stage.command(PEOPLE[0], request)
        for _ in range(5):  # far enough from rest, so that it is not there within a cycle
            stage.cycle()
    assert stage.command(PEOPLE[0], request_)
    stage.cycle()
    before_v = stage.x.drive_v
    stage.run_broken_law(before_v + 1.0, 1, 1)

    assert stage.x.drive_v == before_v


def moved(position_um: float) -> CommandedStage:
    """Return a stage at a position."""
    stage = CommandedStage()
    stage.cycle()
    for request in (
        rq.Arm(),
        rq.SelectMode(mode=Mode.FEEDFORWARD),
        rq.Goto(position_um=position_um),
    ):
        assert stage.command(PEOPLE[0], request)
        stage.cycle()
    stage.run(1.0)
    return stage


@pytest.mark.parametrize("kind", [OutputKind.FALSE_READ_BACK, OutputKind.FROZEN_READ_BACK])
def test_nothing_is_driven_from_a_false_read_back(kind: OutputKind) -> None:
    """The last write and the sensor say 0 V: whatever a person does, no write is at the other."""
    stage = moved(15.0)
    stage.fail_output(kind, 4000, 60.0)
    stage.run(5.0)
    for _ in range(3):
        for request in (rq.Reset(engineer=True), rq.Arm(), rq.Goto(position_um=15.0), rq.Stop()):
            stage.command(PEOPLE[0], request)
            stage.run(1.0)

    assert abs(stage.judged.output.output_v(stage.t_ns)) <= stage.judged.bound_v


@pytest.mark.parametrize(
    "request_",
    [
        rq.Stop(),
        rq.Estop(),
        rq.Goto(position_um=0.0),
        rq.Wave(command_um={"x": Sine(kind="sine", low=0, high=25, frequency_hz=9)}, duration_s=1),
    ],
)
def test_no_write_walks_away_from_an_output(request_: rq.Request) -> None:
    """An output is stuck at 15 µm and obeys again: the stage makes no step, and comes down."""
    stage = moved(15.0)
    stage.fail_output(OutputKind.STUCK, 600, nan)
    stage.command(PEOPLE[0], request_)
    stage.run(5.0)

    stage.recover()


@pytest.mark.stress
def test_no_long_history_breaks_a_limit() -> None:
    """So it is after many events, too."""
    check(60)
