"""A fault of a device, from its first cycle to what the stage does about it, on the rig."""

from functools import cache
from itertools import pairwise
from math import isfinite, nan
from typing import Any

import pytest

from piezod.config import requests as rq
from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.register import Detection
from piezod.control.faults.table import ids
from piezod.control.guard import Admitted, Guard
from piezod.control.watch.loop import CycleTiming
from piezod.devices.status import DeviceFlag
from piezod.telemetry.record import CycleRecord
from piezod.testing.injections import InjectionKind
from tests.control.live_stage import LiveStage, quick
from tests.control.swinging_stage import Case, Faulty, check_way, failed

CASES = [
    Case("S1", InjectionKind.STUCK, {}, State.HOLD, 60),
    Case("S2", InjectionKind.REPLACED, {"value": nan}, State.HOLD, 10),
    Case("S3", InjectionKind.OFFSET, {"value": 500.0}, State.HOLD, 10),
    Case("S5", InjectionKind.DROPPED, {}, State.HOLD, 10),
    Case("S8", InjectionKind.FLAGGED, {"flag": DeviceFlag.LOW_LIGHT}, State.HOLD, 10),
    Case("S9", InjectionKind.GAIN, {"value": 0.4}, State.HOLD, 200),
    Case("A1", InjectionKind.REFUSED, {}, State.BLIND, 10),
    Case("A3", InjectionKind.READ_BACK_OFFSET, {"value": 4.0}, State.HOLD, 20),
    Case("A4", InjectionKind.FLAGGED, {"flag": DeviceFlag.OVERLOAD}, State.HOLD, 3),
    Case("A8", InjectionKind.FLAGGED, {"flag": DeviceFlag.LOCAL_MODE}, State.HOLD, 3),
    Case("A9", InjectionKind.FLAGGED, {"flag": DeviceFlag.WATCHDOG_TRIPPED}, State.BLIND, 3),
    Case("A11", InjectionKind.FLAGGED, {"flag": DeviceFlag.SHORT_OR_OPEN}, State.FAULT, 3),
    Case("A12", InjectionKind.READ_BACK_OFFSET, {"value": 200.0}, State.FAULT, 4),
    Case("A13", InjectionKind.FLAGGED, {"flag": DeviceFlag.OVER_TEMPERATURE}, State.FAULT, 3),
]


@cache
def seen(case: Case) -> tuple[Faulty, list[CycleRecord]]:
    """Return what `failed` does, once for each case."""
    return failed(case)


@pytest.mark.parametrize(
    "case", [pytest.param(one, marks=pytest.mark.fault(one.fault), id=one.fault) for one in CASES]
)
def test_a_fault_leads_to_its_state_in_time_and_nothing_goes_on_by_itself(case: Case) -> None:
    """It is told by its id, the stage leaves RUN within the bound, and ends at rest."""
    check_way(case, *seen(case))


@pytest.mark.parametrize("case", CASES, ids=[case.fault for case in CASES])
def test_limits_hold_while_a_fault_is_reacted_to(case: Case) -> None:
    """Whatever the sensor or the read-back say, no write leaves range or slew rate."""
    stage, _ = seen(case)

    writes = stage.channels.writes
    assert all(isfinite(drive_v) and 0.0 <= drive_v <= 150.0 for _, (drive_v,) in writes)
    for (before_ns, (before_v,)), (t_ns, (drive_v,)) in pairwise(writes):
        assert t_ns - before_ns > stage.period_ns or abs(drive_v - before_v) <= 20.0 + 1e-9


@pytest.mark.parametrize("case", CASES, ids=[case.fault for case in CASES])
def test_once_healed_a_stage_runs_again_when_it_is_told_to(case: Case) -> None:
    """Reset, arm, and where the memory was lost, condition: then it is as before."""
    stage, _ = seen(case)
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
def test_a_spike_is_not_reacted_to() -> None:
    """One sample is replaced or left out; the stage goes on, the drive hardly notices."""
    stage = Faulty()
    stage.fail(InjectionKind.OFFSET, 1, value=8.0)
    after = stage.run(0.5)

    steps_v = [b.axes[0].drive_v - a.axes[0].drive_v for a, b in pairwise(after)]
    assert {record.state for record in after} == {State.RUN}
    assert max(map(abs, steps_v)) < 2.0


@pytest.mark.fault("S5")
def test_a_short_gap_ends_where_it_is_resumed() -> None:
    """Below a second it is held; when samples are back, `resume` goes on."""
    stage = Faulty()
    stage.fail(InjectionKind.DROPPED, 100)
    stage.run(0.5)
    held = stage.state
    stage.do(rq.Resume())
    stage.run(0.2)

    assert (held, stage.state) == (State.HOLD, State.RUN)


def test_a_reset_that_is_refused_drops_no_latch() -> None:
    """In HOLD it is too early for it; `resume` is still refused afterwards."""
    stage = Faulty()
    stage.fail(InjectionKind.FLAGGED, 5, flag=DeviceFlag.OVERLOAD)
    stage.run(1.5)
    held = stage.state
    reset, resumed = stage.ask(rq.Reset()), stage.ask(rq.Resume())

    assert (held, reset.accepted, resumed.accepted) == (State.HOLD, False, False)


@pytest.mark.fault("A7")
def test_an_amplifier_that_collapses_is_taken_over_from_what_it_reads_back() -> None:
    """After BLIND the first write is what is in force, and the way down begins there."""
    stage = Faulty()
    writes = stage.channels.writes
    while stage.x.drive_v < 60.0:
        stage.cycle()
    writes.clear()
    stage.device.deactivate(stage.t_ns)  # its power is gone: 0 V in some milliseconds
    stage.run(0.03)
    stage.device.activate(stage.t_ns)
    stage.run(1.5)

    after = [drive_v for t_ns, (drive_v,) in writes if t_ns > writes[0][0] + 40_000_000]
    assert Fault.A7 in stage.faults() or Fault.A1 in stage.faults()
    assert not after or max(after) < 5.0
    assert stage.state in {State.FAULT, State.SAFE}


@pytest.mark.fault("A4")
def test_an_amplifier_that_is_overloaded_may_go_half_as_fast(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For as long as the fault is shown, and no longer."""
    stage, halved = Faulty(), []
    admit = Guard.admit

    def seen(guard: Guard, *arguments: Any) -> Admitted:
        halved.append(list(arguments[-1]))
        return admit(guard, *arguments)

    monkeypatch.setattr(Guard, "admit", seen)
    stage.cycle()
    stage.fail(InjectionKind.FLAGGED, 5, flag=DeviceFlag.OVERLOAD)
    stage.run(0.005)
    during = halved[-1]
    stage.run(0.1)

    assert (halved[0], during, halved[-1]) == ([], [0], [])


@pytest.mark.fault("A8")
def test_while_somebody_else_drives_nothing_is_written_and_then_it_is_taken_over() -> None:
    """However long it takes; the voltage that is held afterwards is what they left."""
    stage = Faulty()
    stage.fail(InjectionKind.FLAGGED, 3000, flag=DeviceFlag.LOCAL_MODE)
    stage.run(0.002)
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
def test_what_somebody_else_left_is_not_guessed() -> None:
    """Without a read-back nobody knows it: FAULT, and no write."""
    stage = Faulty(Mode.FEEDFORWARD, reads_back=False, holds=True)
    stage.fail(InjectionKind.FLAGGED, 100, flag=DeviceFlag.LOCAL_MODE)
    stage.run(0.002)
    stage.channels.writes.clear()
    stage.until("FAULT")

    assert stage.channels.writes == []


@pytest.mark.fault("D6")
def test_an_axis_that_oscillates_goes_with_half_its_gain_until_it_is_reset() -> None:
    """Half a second later, if it still oscillates, it goes on in feedforward."""
    stage = Faulty(Mode.TRIMMED)
    trim, seen = stage.stage.axes[0].law.trim, []
    for _ in range(502):
        stage.controller.report(Detection(Fault.D6, 0))
        stage.cycle()
        seen.append((trim.gain_halved, stage.x.mode))
    stage.run(1.1)
    still = trim.gain_halved
    stage.do(rq.Reset())
    stage.run(0.01)

    assert seen[1] == (True, Mode.TRIMMED)
    assert seen[-1] == (True, Mode.FEEDFORWARD)
    assert (still, trim.gain_halved) == (True, False)
    assert stage.state == State.RUN


@pytest.mark.fault("D10")
def test_a_memory_that_is_not_known_is_shown_until_it_is_conditioned() -> None:
    """While it is relied on: not in SAFE, and not where nothing is compensated."""
    stage = LiveStage(quick(), memory_known=False)
    stage.cycle()
    before = ids(stage.records[-1].present)
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
    assert ids(stage.records[-1].present) == []
    assert set(stage.faults()) == {Fault.D10}


@pytest.mark.fault("P3")
@pytest.mark.parametrize("kind", [InjectionKind.READ_RAISES, InjectionKind.WRITE_RAISES])
def test_a_driver_that_raises_is_a_fault_and_no_crash(kind: InjectionKind) -> None:
    """The cycle goes on, the stage is held or blind within two cycles, and ends safe."""
    stage = Faulty()
    stage.fail(kind, 50)
    first = stage.run(0.01)[3]
    stage.run(3.5)

    assert Fault.P3 in stage.faults()
    assert first.state in {State.HOLD, State.RAMP, State.BLIND}
    assert stage.state in {State.SAFE, State.FAULT}


@pytest.mark.fault("P4")
def test_a_control_law_that_raises_holds_the_voltage(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mistake in the program is no reason to drop 100 V."""
    stage = Faulty()

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(stage.stage.axes[0].law, "update", broken)
    before_v = stage.x.drive_v
    after = stage.run(0.02)

    assert Fault.P4 in stage.faults()
    assert {record.axes[0].drive_v for record in after} == {before_v}
    assert stage.state == State.HOLD


@pytest.mark.fault("L2")
def test_a_long_gap_holds() -> None:
    """Seven periods that were skipped at once: what was planned is no longer true."""
    stage = Faulty()
    stage.cycle(CycleTiming(0, 7, 10_000, 0, 0))

    assert Fault.L2 in stage.faults()
    assert stage.state == State.HOLD


@pytest.mark.fault("L2")
def test_a_gap_while_disarmed_is_over_when_it_is_over() -> None:
    """There was nothing to hold: arming needs no `resume` or `reset` before it."""
    stage = LiveStage()
    stage.cycle()
    stage.cycle(CycleTiming(0, 7, 10_000, 0, 0))
    too_early = stage.ask(rq.Arm())
    stage.run(0.1)
    stage.do(rq.Arm())

    assert Fault.L2 in stage.faults()
    assert not too_early.accepted


@pytest.mark.fault("L5")
def test_a_process_that_stood_still_ramps() -> None:
    """A tenth of a second at once: nobody knows what the stage did meanwhile."""
    stage = Faulty()
    stage.cycle(CycleTiming(0, 100, 10_000, 0, 0))

    assert Fault.L5 in stage.faults()
    assert stage.state == State.RAMP


def fallen_during_a_pause(flag: DeviceFlag | None = None) -> Faulty:
    """Return a stage whose output fell from about 13 V to 0 while its loop stood still for 4 s."""
    stage = Faulty()
    while not 12.0 < stage.x.drive_v < 15.0:
        stage.cycle()
    stage.device.deactivate(stage.t_ns)
    stage.device.activate(stage.t_ns)
    if flag is not None:
        stage.fail(InjectionKind.FLAGGED, 4005, flag=flag)
    stage.channels.writes.clear()
    stage.cycle(CycleTiming(0, 4000, 10_000, 0, 0))
    return stage


@pytest.mark.fault("A9")
def test_a_watchdog_that_tripped_is_told_and_the_way_down_begins_where_the_output_is() -> None:
    """However little it fell, and though the loop stood still: nothing near the old voltage."""
    stage = fallen_during_a_pause(DeviceFlag.WATCHDOG_TRIPPED)
    blind, sent = stage.state, len(stage.channels.writes)
    stage.until("RAMP")
    stage.run(1.0)

    assert Fault.A9 in stage.faults()
    assert (blind, sent) == (State.BLIND, 0)
    assert max(drive_v for _, (drive_v,) in stage.channels.writes) < 0.8
    assert stage.state == State.FAULT


@pytest.mark.fault("A9")
def test_a_watchdog_that_stays_tripped_does_not_keep_a_stage_from_its_safe_voltage() -> None:
    """Many tell so until they take a write: the stage is ramped after the first wait."""
    stage = Faulty()
    stage.fail(InjectionKind.FLAGGED, None, flag=DeviceFlag.WATCHDOG_TRIPPED)
    stage.until("RAMP", within_s=0.2)
    stage.until("FAULT")

    assert stage.faults().count(Fault.A9) == 1
    assert stage.x.drive_v == pytest.approx(0.0, abs=5e-3)


@pytest.mark.fault("L5")
def test_a_way_down_begins_where_the_output_has_just_fallen() -> None:
    """Nothing but the read-back tells that it has, and by less than a collapse."""
    stage = fallen_during_a_pause()
    state = stage.state
    stage.run(1.0)

    assert state == State.RAMP
    assert max(drive_v for _, (drive_v,) in stage.channels.writes) < 0.8


@pytest.mark.parametrize("off_v", [30.0, nan])
def test_no_way_down_begins_with_a_step_up(off_v: float) -> None:
    """A single answer that is wrong, or none, does not make it begin elsewhere."""
    stage = Faulty()
    before_v = stage.x.drive_v
    stage.fail(InjectionKind.READ_BACK_OFFSET, 1, value=off_v)
    stage.cycle()
    last_v = stage.x.drive_v
    stage.ask(rq.Stop())

    assert stage.state == State.RAMP
    assert abs(last_v - before_v) < 2.0
    assert last_v - 0.3 < stage.x.drive_v <= last_v


@pytest.mark.fault("L1")
def test_a_single_overrun_is_counted_and_no_more() -> None:
    """The stage goes on."""
    stage = Faulty()
    record = stage.cycle(CycleTiming(0, 1, 1_900_000, 0, 0))

    assert ids(record.present) == [Fault.L1]
    assert stage.faults() == []
    assert stage.state == State.RUN


@pytest.mark.fault("L4")
def test_a_wall_clock_that_jumps_changes_nothing() -> None:
    """Positions and voltages are those of a twin whose clock did not jump."""
    jumped, twin = Faulty(), Faulty()
    hour_ns = 3600 * 10**9
    ours = [jumped.cycle(CycleTiming(0, 0, 10_000, hour_ns, 0)) for _ in range(500)]
    theirs = [twin.cycle(CycleTiming(0, 0, 10_000, 0, 0)) for _ in range(500)]

    assert [record.axes[0].drive_v for record in ours] == [
        record.axes[0].drive_v for record in theirs
    ]
    assert ids(jumped.records[-500].present) == [Fault.L4]


@pytest.mark.fault("C9")
def test_a_fault_in_feedforward_needs_no_sensor_to_be_told() -> None:
    """A stream that stops is held, whatever the mode."""
    stage = Faulty(Mode.FEEDFORWARD)
    stage.do(rq.Stream(axes=("x",)))
    stage.run(0.2)

    assert stage.state == State.HOLD
