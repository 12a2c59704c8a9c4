"""Tests of what a stage does about late cycles: a stall is survived, lasting lateness holds it."""

import numpy as np
import pytest

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.watch.loop import CycleTiming
from piezod.hysteresis.memory import FloatArray
from piezod.messages import requests as rq
from piezod.telemetry.record import CycleRecord
from piezod.testing.injections import InjectionKind
from tests.conftest import Reaction
from tests.control.fault_cases import SwingingStage
from tests.control.rig_stage import RigStage, cycles_until, has_left_run

OFTEN_LATE = CycleTiming(0, 1, 10_000, 0, 0)
CYCLES_TO_L2 = 700  # of two periods each: more than a tenth of those of the last 5 s, at 1 kHz
PUNCTUAL_WITHIN_S = 5.5


def stall(periods: int) -> CycleTiming:
    """Return the timing of the cycle after a stall."""
    return CycleTiming(0, periods, 10_000, 0, 0)


def late_for_long(stage: SwingingStage) -> None:
    """Lose every second period, until the stage holds."""
    for _ in range(CYCLES_TO_L2):
        stage.cycle(OFTEN_LATE)
        if stage.state == State.HOLD:
            return
    raise AssertionError(stage.state)


def steps_v(records: list[CycleRecord]) -> FloatArray:
    """Return the absolute steps of the drive from cycle to cycle, in V."""
    drive_v = np.array([record.axes[0].drive_v for record in records])
    steps: FloatArray = np.abs(np.diff(drive_v))
    return steps


@pytest.mark.fault("L1")
@pytest.mark.parametrize("periods", [7, 100, 180])
def test_stall_is_survived(periods: int) -> None:
    """The stage stays in RUN and in its mode, and steps within the slew rate."""
    stage = SwingingStage()
    before = len(stage.records)
    stage.cycle(stall(periods))
    stage.run(0.5)
    after = stage.records[before - 1 :]
    limits = stage.stage.axes[0].law.limits

    assert {record.state for record in after} == {State.RUN}
    assert {record.axes[0].mode for record in after} == {Mode.ADAPTIVE}
    assert steps_v(after).max() <= limits.slew_v_per_s * stage.period_ns * 1e-9 + 1e-9
    assert Fault.L1 not in stage.faults()  # it is counted, and does not fill the log


@pytest.mark.fault("L1")
def test_command_goes_on_in_time_after_a_stall() -> None:
    """Its phase is that of a stage without a stall, and the error is as small soon after."""
    stalled, twin = SwingingStage(), SwingingStage()
    stalled.cycle(stall(40))
    twin.run(0.2)
    twin.cycle()
    ours, theirs = stalled.run(0.5), twin.run(0.5)

    assert ours[0].t_ns == theirs[0].t_ns
    assert [record.axes[0].command_um for record in ours] == pytest.approx(
        [record.axes[0].command_um for record in theirs]
    )
    errors_um = [
        abs(record.axes[0].command_um - record.axes[0].position_um)
        for records in (ours, theirs)
        for record in records[-20:]
    ]
    assert max(errors_um[:20]) < max(errors_um[20:]) + 0.1


@pytest.mark.fault("L2")
def test_lasting_lateness_holds_and_goes_on_by_itself(reaction: Reaction) -> None:
    """The movement goes on in the same mode, without a step, when the cycles are punctual."""
    stage = SwingingStage(rate_hz=1000.0)
    motion, before_ns = stage.x.motion, stage.t_ns
    late_for_long(stage)
    reaction("L2", cycles=stage.cycles_to(Fault.L2, before_ns))
    held_v = {record.axes[0].drive_v for record in stage.run(0.5)}
    stage.until("RUN", within_s=PUNCTUAL_WITHIN_S)
    resumed = stage.run(1.0)

    assert len(held_v) == 1
    assert stage.faults()[-1] == Fault.L2
    assert [event.kind for event in stage.events].count("lateness") == 1
    assert {(record.state, record.axes[0].mode) for record in resumed} == {
        (State.RUN, Mode.ADAPTIVE)
    }
    assert {record.axes[0].motion for record in resumed} == {motion}
    assert steps_v(resumed).max() < 2.0
    assert np.ptp([record.axes[0].position_um for record in resumed]) > 18.0


@pytest.mark.fault("L2")
def test_refusal_names_the_lateness() -> None:
    """The stage is held because of L2, and not because of a request."""
    stage = SwingingStage()
    late_for_long(stage)

    assert "because of L2)" in stage.ask(rq.Goto(position_um=1.0)).why


@pytest.mark.fault("L2")
def test_movement_to_a_position_arrives_after_lasting_lateness() -> None:
    """A client that waits for its movement sees it arrive."""
    stage = SwingingStage()
    stage.do(rq.Goto(position_um=12.0, speed_um_per_s=2.0))
    motion = stage.x.motion
    late_for_long(stage)
    stage.until("RUN", within_s=8.0)
    stage.run(4.0)

    assert stage.x.motion == motion
    assert stage.x.on_target
    assert stage.x.position_um == pytest.approx(12.0, abs=0.1)


@pytest.mark.fault("L2")
def test_person_ends_the_wait_for_punctuality() -> None:
    """After `hold` only a person resumes; `stop` ramps."""
    held, stopped = SwingingStage(), SwingingStage()
    for stage in (held, stopped):
        late_for_long(stage)
    held.do(rq.Hold())
    held.run(8.0)
    state = held.state
    held.do(rq.Resume())
    stopped.do(rq.Stop())

    assert (state, held.state, stopped.state) == (State.HOLD, State.RUN, State.RAMP)


@pytest.mark.fault("L2")
@pytest.mark.fault("S2")
def test_other_fault_ends_the_wait_for_punctuality() -> None:
    """A sensor that fails meanwhile makes it a HOLD that only a person ends, and that expires."""
    stage = SwingingStage()
    late_for_long(stage)
    stage.fail(InjectionKind.REPLACED, 200, value=float("nan"))
    stage.run(0.1)
    state = stage.state
    stage.run(3.0)

    assert Fault.S2 in stage.faults()
    assert state == State.HOLD
    assert stage.state in {State.RAMP, State.SAFE, State.FAULT}


@pytest.mark.fault("L2")
def test_resume_and_arm_are_refused_while_the_cycles_are_late() -> None:
    """The refusal names the fault; nobody has to reset it."""
    stage, idle = SwingingStage(), RigStage()
    late_for_long(stage)
    refusal = stage.ask(rq.Resume())
    for _ in range(CYCLES_TO_L2):
        idle.cycle(OFTEN_LATE)
    too_early = idle.ask(rq.Arm())
    idle.run(6.0)

    assert not refusal.accepted
    assert "L2" in refusal.why
    assert not too_early.accepted
    assert "L2" in too_early.why
    idle.do(rq.Arm())


@pytest.mark.fault("L5")
def test_pause_of_a_second_holds_until_a_person_resumes(reaction: Reaction) -> None:
    """After two seconds without one the stage ramps."""
    stage = SwingingStage()
    first = stage.cycle(stall(200))
    state, mode = stage.state, stage.x.mode
    reaction("L5", cycles=cycles_until([first], has_left_run))
    stage.run(2.1)

    assert Fault.L5 in stage.faults()
    assert (state, mode) == (State.HOLD, Mode.FEEDFORWARD)
    assert stage.state == State.RAMP


@pytest.mark.fault("L2")
@pytest.mark.fault("L5")
@pytest.mark.parametrize(
    ("periods", "fault", "state"), [(7, Fault.L2, State.HOLD), (20, Fault.L5, State.RAMP)]
)
def test_strict_stall_stops_the_stage(periods: int, fault: Fault, state: State) -> None:
    """With `strict_rt` seven lost periods hold the stage; a tenth of a second ramps it."""
    stage = SwingingStage(strict_rt=True)
    stage.cycle(stall(periods))
    stage.run(1.0)

    assert fault in stage.faults()
    assert stage.state in {state, State.SAFE, State.FAULT}
