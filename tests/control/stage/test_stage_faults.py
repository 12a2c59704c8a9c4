"""Tests of faults of devices on the rig, from the first cycle to the reaction of the stage."""

from functools import cache
from itertools import pairwise
from math import isfinite, nan
from typing import Any

import pytest

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.detection import Detection
from piezod.control.faults.table import ids
from piezod.control.guard import Admitted, Guard
from piezod.control.law.axis import AxisOutput
from piezod.control.watch.loop import CycleTiming
from piezod.devices.interface import Sample
from piezod.devices.status import DeviceFlag
from piezod.messages import requests as rq
from piezod.telemetry.record import CycleRecord
from piezod.testing.injections import InjectionKind
from tests.conftest import Reaction
from tests.control.fault_cases import (
    SLEW_STEP_V,
    FaultCase,
    SwingingStage,
    check_course,
    run_case,
)
from tests.control.rig_stage import (
    FaultyStage,
    RigStage,
    cycles_until,
    has_left_run,
    quick_config,
    with_axis,
)
from tests.control.surface_rig import EACH_MODEL, with_model

CASES = [
    FaultCase("S1", InjectionKind.STUCK, {}, State.HOLD, 60),
    FaultCase("S2", InjectionKind.REPLACED, {"value": nan}, State.HOLD, 10),
    FaultCase("S3", InjectionKind.OFFSET, {"value": 500.0}, State.HOLD, 10),
    FaultCase("S5", InjectionKind.DROPPED, {}, State.HOLD, 10),
    FaultCase("S7", InjectionKind.FLAGGED, {"flag": DeviceFlag.SATURATED}, State.HOLD, 10),
    FaultCase("S8", InjectionKind.FLAGGED, {"flag": DeviceFlag.LOW_LIGHT}, State.HOLD, 10),
    FaultCase("S9", InjectionKind.GAIN, {"value": 0.4}, State.HOLD, 200),
    FaultCase("S11", InjectionKind.DUPLICATE, {}, State.HOLD, 10),
    FaultCase("A1", InjectionKind.REFUSED, {}, State.BLIND, 10),
    FaultCase("A3", InjectionKind.READ_BACK_OFFSET, {"value": 4.0}, State.HOLD, 20),
    FaultCase("A4", InjectionKind.FLAGGED, {"flag": DeviceFlag.OVERLOAD}, State.HOLD, 3),
    FaultCase("A8", InjectionKind.FLAGGED, {"flag": DeviceFlag.LOCAL_MODE}, State.HOLD, 3),
    FaultCase("A9", InjectionKind.FLAGGED, {"flag": DeviceFlag.WATCHDOG_TRIPPED}, State.BLIND, 3),
    FaultCase("A11", InjectionKind.FLAGGED, {"flag": DeviceFlag.SHORT_OR_OPEN}, State.FAULT, 3),
    FaultCase("A12", InjectionKind.READ_BACK_OFFSET, {"value": 200.0}, State.FAULT, 4),
    FaultCase("A13", InjectionKind.FLAGGED, {"flag": DeviceFlag.OVER_TEMPERATURE}, State.FAULT, 3),
]


@cache
def result_of(case: FaultCase) -> tuple[SwingingStage, list[CycleRecord]]:
    """Return the result of `run_case`, computed once for each case."""
    return run_case(case)


@pytest.mark.parametrize(
    "case", [pytest.param(one, marks=pytest.mark.fault(one.fault), id=one.fault) for one in CASES]
)
def test_fault_leads_to_its_state_in_time_and_to_rest(case: FaultCase, reaction: Reaction) -> None:
    """The fault is reported, the stage leaves RUN within the bound, and ends at rest."""
    check_course(case, *result_of(case), reaction)


@pytest.mark.fault("S9")
@pytest.mark.parametrize("model", EACH_MODEL[1:])
def test_position_beside_the_loops_of_a_surface_holds_the_stage(
    model: str, reaction: Reaction
) -> None:
    """The same case for a stage whose model is a surface: the sensor shows 40 % of each move."""
    (case,) = (one for one in CASES if one.fault == "S9")

    check_course(case, *run_case(case, model), reaction)


@pytest.mark.parametrize("case", CASES, ids=[case.fault for case in CASES])
def test_limits_hold_during_the_reaction(case: FaultCase) -> None:
    """No write leaves the range or the slew rate, for any sample and read-back."""
    stage, _ = result_of(case)

    writes = stage.channels.writes
    assert all(isfinite(drive_v) and 0.0 <= drive_v <= 150.0 for _, (drive_v,) in writes)
    for (before_ns, (before_v,)), (t_ns, (drive_v,)) in pairwise(writes):
        assert t_ns - before_ns > stage.period_ns or abs(drive_v - before_v) <= SLEW_STEP_V


@pytest.mark.parametrize("case", CASES, ids=[case.fault for case in CASES])
def test_stage_runs_again_after_reset_and_arm(case: FaultCase) -> None:
    """If the memory was lost, conditioning makes it known; then the stage works as before."""
    stage, _ = result_of(case)
    stage.run(1.0)
    stage.do(rq.Reset(engineer=True))
    stage.run(0.1)
    stage.do(rq.Arm())
    if "condition" in stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE)).why:
        stage.do(rq.Condition())
        stage.until("READY", within_s=15.0)
    stage.do(rq.SelectMode(mode=Mode.ADAPTIVE), rq.Goto(position_um=10.0))
    stage.run(0.3)

    assert stage.x.position_um == pytest.approx(10.0, abs=0.5)


@pytest.mark.fault("S4")
def test_spike_has_no_reaction() -> None:
    """The sample is dropped, the stage continues, and the drive hardly changes."""
    stage = SwingingStage()
    stage.fail(InjectionKind.OFFSET, 1, value=8.0)
    after = stage.run(0.5)

    steps_v = [b.axes[0].drive_v - a.axes[0].drive_v for a, b in pairwise(after)]
    assert {record.state for record in after} == {State.RUN}
    assert max(map(abs, steps_v)) < 5.0  # the sine itself makes steps of 4 V


@pytest.mark.fault("S4")
def test_nothing_is_learned_from_a_spike() -> None:
    """The weights do not change with it, and are later those of a stage that missed the sample."""
    spiked, missed = SwingingStage(), SwingingStage()
    adaptations = [each.stage.axes[0].law.identifier.adaptation for each in (spiked, missed)]
    before = adaptations[0].weights.copy()
    spiked.fail(InjectionKind.OFFSET, 1, value=8.0)
    missed.fail(InjectionKind.DROPPED, 1)
    for stage in (spiked, missed):
        stage.cycle()
    after, seen = adaptations[0].weights.copy(), spiked.records[-1]
    for stage in (spiked, missed):
        stage.run(0.5)

    assert ids(seen.present) == [Fault.S4]
    assert after.tolist() == before.tolist()
    assert adaptations[0].weights.tolist() == adaptations[1].weights.tolist() != before.tolist()


def test_refused_reset_drops_no_latch() -> None:
    """In HOLD a reset is refused, and `resume` still is afterwards."""
    stage = SwingingStage()
    stage.fail(InjectionKind.FLAGGED, 5, flag=DeviceFlag.OVERLOAD)
    stage.run(1.5)
    held = stage.state
    reset, resumed = stage.ask(rq.Reset()), stage.ask(rq.Resume())

    assert (held, reset.accepted, resumed.accepted) == (State.HOLD, False, False)


@pytest.mark.fault("A5")
def test_voltage_that_is_not_a_number_is_not_written(
    monkeypatch: pytest.MonkeyPatch, reaction: Reaction
) -> None:
    """The amplifier keeps its voltage, and the stage holds it."""
    stage = SwingingStage()
    law, before_v = stage.stage.axes[0].law, stage.x.drive_v
    update = law.update

    def broken(t_ns: int, sample: Sample) -> AxisOutput:
        output = update(t_ns, sample)
        output.drive_v = nan
        return output

    monkeypatch.setattr(law, "update", broken)
    stage.channels.writes.clear()
    after = stage.run(0.1)

    assert {drive_v for _, (drive_v,) in stage.channels.writes} <= {before_v}
    assert stage.faults() == [Fault.A5]
    assert stage.state == State.HOLD
    reaction("A5", cycles=cycles_until(after, has_left_run))


@pytest.mark.fault("A4")
def test_ramp_of_an_overloaded_amplifier_has_half_the_slew_rate() -> None:
    """A ramp that would be faster is slowed down while the fault is present."""
    config = quick_config()
    axis = config.axes["x"]
    steep = axis.safety.model_copy(update={"ramp_v_per_s": axis.limits.slew_v_per_s})
    stage = FaultyStage(with_axis(config, safety=steep)).armed(rq.Goto(position_um=20.0))
    stage.run(1.0)
    stage.fail(InjectionKind.FLAGGED, flag=DeviceFlag.OVERLOAD)
    stage.until("FAULT")

    written_v = [drive_v for _, (drive_v,) in stage.channels.writes]
    most_v = axis.limits.slew_v_per_s * stage.period_ns * 1e-9
    assert max(a - b for a, b in pairwise(written_v)) == pytest.approx(most_v / 2)


@pytest.mark.fault("A4")
def test_overloaded_amplifier_has_half_the_slew_rate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The slew rate is halved while the fault is present."""
    stage, halved = SwingingStage(), []
    admit = Guard.admit

    def seen(guard: Guard, *arguments: Any) -> Admitted:
        halved.append(list(arguments[6]))
        return admit(guard, *arguments)

    monkeypatch.setattr(Guard, "admit", seen)
    stage.cycle()
    stage.fail(InjectionKind.FLAGGED, 5, flag=DeviceFlag.OVERLOAD)
    stage.run(0.025)
    during = halved[-1]
    stage.run(0.1)

    assert (halved[0], during, halved[-1]) == ([], [0], [])


@pytest.mark.fault("A8")
def test_nothing_is_written_in_local_mode_and_then_the_output_is_taken_over() -> None:
    """The voltage that is held afterwards is the one that was left."""
    stage = SwingingStage()
    stage.fail(InjectionKind.FLAGGED, 600, flag=DeviceFlag.LOCAL_MODE)
    stage.run(0.01)
    stage.channels.writes.clear()
    stage.device.write([33.0], stage.t_ns)
    stage.run(2.9)
    silent, held = len(stage.channels.writes), stage.state
    stage.run(0.2)
    resumed = stage.ask(rq.Resume())

    assert (silent, held) == (0, State.HOLD)
    assert stage.channels.writes[0][1] == pytest.approx((33.0,), abs=0.5)
    assert stage.faults() == [Fault.A8]
    assert resumed.accepted


@pytest.mark.fault("A8")
def test_output_after_local_mode_is_unknown_without_read_back() -> None:
    """The result is FAULT, without a write."""
    stage = SwingingStage(Mode.FEEDFORWARD, reads_back=False, holds=True)
    stage.fail(InjectionKind.FLAGGED, 100, flag=DeviceFlag.LOCAL_MODE)
    stage.run(0.01)
    stage.channels.writes.clear()
    stage.until("FAULT")

    assert stage.channels.writes == []


@pytest.mark.fault("D6")
def test_oscillating_axis_has_half_the_gain_until_a_reset() -> None:
    """If it still oscillates half a second later, it continues in feedforward."""
    stage = SwingingStage(Mode.TRIMMED)
    trim, seen = stage.stage.axes[0].law.trim, []
    for _ in range(102):
        stage.controller.report(Detection(Fault.D6, 0))
        stage.cycle()
        seen.append((trim.gain_halved, stage.x.mode))
    stage.run(1.1)
    halved_before_reset = trim.gain_halved
    stage.do(rq.Reset())
    stage.run(0.01)

    assert seen[1] == (True, Mode.TRIMMED)
    assert seen[-1] == (True, Mode.FEEDFORWARD)
    assert (halved_before_reset, trim.gain_halved) == (True, False)
    assert stage.state == State.RUN


@pytest.mark.fault("D10")
@pytest.mark.parametrize("model", EACH_MODEL)
def test_unknown_memory_is_shown_until_conditioning(model: str, reaction: Reaction) -> None:
    """It is shown while it matters: not in SAFE, and not in mode uncompensated."""
    stage = RigStage(with_model(quick_config(), model), memory_known=False)
    stage.cycle()
    before = ids(stage.records[-1].present)
    before_ns = stage.t_ns
    stage.do(rq.Arm())
    armed = ids(stage.records[-1].present)
    stage.do(rq.SelectMode(mode=Mode.UNCOMPENSATED))
    stage.run(0.1)
    uncompensated = ids(stage.records[-1].present)
    stage.do(rq.Stop())
    stage.until("SAFE")
    stage.do(rq.SelectMode(mode=Mode.FEEDFORWARD), rq.Arm(), rq.Condition())
    stage.until("READY", within_s=60.0)
    stage.run(0.1)

    assert (before, armed, uncompensated) == ([], [Fault.D10], [])
    reaction("D10", cycles=stage.cycles_to(Fault.D10, before_ns))
    assert ids(stage.records[-1].present) == []
    assert set(stage.faults()) == {Fault.D10}


@pytest.mark.fault("P3")
@pytest.mark.parametrize("kind", [InjectionKind.READ_RAISES, InjectionKind.WRITE_RAISES])
def test_exception_of_a_driver_is_a_fault(kind: InjectionKind, reaction: Reaction) -> None:
    """The cycles continue, the stage holds or is blind within two cycles, and ends safe."""
    stage = SwingingStage()
    stage.fail(kind, 50)
    after = stage.run(0.05)
    stage.run(3.5)

    assert Fault.P3 in stage.faults()
    reaction("P3", cycles=cycles_until(after, has_left_run))
    assert after[-1].state in {State.HOLD, State.RAMP, State.BLIND}
    assert stage.state in {State.SAFE, State.FAULT}


@pytest.mark.fault("P4")
def test_exception_of_the_control_law_holds_the_voltage(
    monkeypatch: pytest.MonkeyPatch, reaction: Reaction
) -> None:
    """The voltage is not dropped."""
    stage = SwingingStage()

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(stage.stage.axes[0].law, "update", broken)
    before_v = stage.x.drive_v
    after = stage.run(0.1)

    assert Fault.P4 in stage.faults()
    reaction("P4", cycles=cycles_until(after, has_left_run))
    assert {record.axes[0].drive_v for record in after} == {before_v}
    assert stage.state == State.HOLD


@pytest.mark.fault("L1")
def test_single_overrun_is_only_counted(reaction: Reaction) -> None:
    """The stage continues."""
    stage = SwingingStage()
    record = stage.cycle(CycleTiming(0, 1, 1_900_000, 0, 0))

    assert ids(record.present) == [Fault.L1]
    reaction("L1", cycles=cycles_until([record], lambda each: Fault.L1 in ids(each.present)))
    assert stage.faults() == []
    assert stage.state == State.RUN


@pytest.mark.fault("L4")
def test_jump_of_the_wall_clock_changes_nothing(reaction: Reaction) -> None:
    """The voltages are those of a stage whose clock did not jump."""
    jumped, twin = SwingingStage(), SwingingStage()
    hour_ns = 3600 * 10**9
    ours = [jumped.cycle(CycleTiming(0, 0, 10_000, hour_ns, 0)) for _ in range(100)]
    theirs = [twin.cycle(CycleTiming(0, 0, 10_000, 0, 0)) for _ in range(100)]

    assert [record.axes[0].drive_v for record in ours] == [
        record.axes[0].drive_v for record in theirs
    ]
    shown = cycles_until(ours, lambda each: ids(each.present) == [Fault.L4])
    reaction("L4", cycles=shown)


@pytest.mark.fault("C9")
def test_stream_that_stops_holds_in_feedforward(reaction: Reaction) -> None:
    """The mode does not matter."""
    stage = SwingingStage(Mode.FEEDFORWARD, rate_hz=1000.0)
    before = len(stage.records)
    stage.do(rq.Stream(axes=("x",)))
    stage.run(0.2)

    assert stage.state == State.HOLD
    reaction("C9", cycles=cycles_until(stage.records[before:], has_left_run))
