"""Tests of takeovers in which the read-back, the last write and the sensor do not agree."""

from collections.abc import Sequence
from itertools import pairwise
from math import nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.table import ids
from piezod.devices.status import DeviceFlag
from piezod.messages import requests as rq
from piezod.testing.injections import InjectionKind
from tests.control.fault_cases import SwingingStage
from tests.control.rig_stage import FaultyStage

SLEW_STEP_V = 4.0
TOLERANCE_V = 0.75


def standing(position_um: float = 18.0, mode: Mode = Mode.FEEDFORWARD) -> FaultyStage:
    """Return a stage that stands at a position, with an empty list of writes."""
    stage = FaultyStage().armed(rq.SelectMode(mode=mode), rq.Goto(position_um=position_um))
    stage.run(0.5)
    stage.channels.writes.clear()
    return stage


def standing_with_stuck_sensor() -> FaultyStage:
    """Return a stage that stands, and whose sensor shows its position for ever."""
    stage = standing()
    stage.fail(InjectionKind.STUCK)
    stage.run(0.05)
    return stage


def written_v(stage: FaultyStage) -> list[float]:
    """Return the voltages written since the list was cleared."""
    return [drive_v for _, (drive_v,) in stage.channels.writes]


def disagreements(stage: FaultyStage) -> list[str]:
    """Return the reports of evidence that does not agree."""
    return [event.text for event in stage.events if "do not agree" in event.text]


@pytest.mark.fault("A7")
@pytest.mark.parametrize("factor", [0.0, 0.5])
@pytest.mark.parametrize("sensor_lost", [False, True])
def test_wrong_read_back_makes_no_step(factor: float, sensor_lost: bool) -> None:
    """The ramp starts at the last write if the sensor shows it; otherwise nothing is written."""
    stage = standing()
    before_v = stage.x.drive_v
    stage.fail(InjectionKind.READ_BACK_OFFSET, value=(factor - 1.0) * before_v)
    if sensor_lost:
        stage.fail(InjectionKind.DROPPED, 300)
    stage.cycle()
    blind = stage.state
    stage.until("FAULT")
    steps_v = [abs(a - b) for a, b in pairwise([before_v, *written_v(stage)])]

    assert blind == State.BLIND
    assert max(steps_v, default=0.0) <= SLEW_STEP_V
    assert bool(steps_v) is not sensor_lost
    assert f"last write {before_v:.4g} V" in disagreements(stage)[0]


@pytest.mark.fault("A7")
@pytest.mark.parametrize(
    ("flag", "sensor_lost"),
    [(None, False), (DeviceFlag.RESTARTED, False), (DeviceFlag.RESTARTED, True)],
)
def test_ramp_after_a_loss_of_power_makes_no_step_up(
    flag: DeviceFlag | None, sensor_lost: bool
) -> None:
    """The sensor shows the fall, or the amplifier reports it."""
    stage = standing()
    stage.device.deactivate(stage.t_ns)
    stage.device.activate(stage.t_ns)
    if flag is not None:
        stage.fail(InjectionKind.FLAGGED, 3, flag=flag)
    if sensor_lost:
        stage.fail(InjectionKind.DROPPED, 300)
    stage.cycle()
    blind = stage.state
    stage.until("FAULT")

    assert blind == State.BLIND
    assert max(written_v(stage)) < TOLERANCE_V


@pytest.mark.fault("A7")
@pytest.mark.fault("A8")
@pytest.mark.parametrize(
    "flags",
    [(DeviceFlag.RESTARTED,), (DeviceFlag.RESTARTED, DeviceFlag.LOCAL_MODE)],
    ids=", ".join,
)
def test_stuck_sensor_does_not_hide_a_reported_fall(flags: Sequence[DeviceFlag]) -> None:
    """The amplifier reports that its output changed; the sensor still shows the old position."""
    stage = standing_with_stuck_sensor()
    stage.channels.writes.clear()
    stage.device.inner.write([0.0], stage.t_ns)
    for flag in flags:
        stage.fail(InjectionKind.FLAGGED, 4, flag=flag)
        stage.run(0.02)
    blind = stage.state
    stage.until("RAMP")
    stage.run(0.1)

    assert blind == State.BLIND
    assert max(written_v(stage)) < TOLERANCE_V
    assert "the amplifier reports that its output has changed" in disagreements(stage)[0]


def test_voltage_that_a_person_set_during_a_loss_is_taken_over() -> None:
    """In local mode the last write is not in force, although the stuck sensor shows it."""
    stage = standing_with_stuck_sensor()
    stage.fail(InjectionKind.READ_BACK_OFFSET, 30, value=nan)
    stage.run(0.05)
    blind = stage.state
    stage.fail(InjectionKind.FLAGGED, 20, flag=DeviceFlag.LOCAL_MODE)
    stage.cycle()
    stage.device.inner.write([10.0], stage.t_ns)
    stage.channels.writes.clear()
    stage.until("SAFE")

    assert blind == State.BLIND
    assert written_v(stage)[0] == pytest.approx(10.0, abs=SLEW_STEP_V)


def test_acknowledged_write_in_local_mode_is_not_taken_for_the_output() -> None:
    """A ramp goes on in local mode, acknowledged; a person has set another voltage."""
    stage = standing_with_stuck_sensor()
    stage.do(rq.Stop())
    stage.fail(InjectionKind.FLAGGED, 2, flag=DeviceFlag.LOCAL_MODE)
    stage.cycle()
    stage.cycle()
    stage.device.inner.write([3.0], stage.t_ns)
    stage.fail(InjectionKind.LOST, 30, flag=DeviceFlag.DISCONNECTED)
    stage.until("BLIND")
    stage.channels.writes.clear()
    stage.until("RAMP")
    stage.cycle()

    assert max(written_v(stage)) <= 3.0 + TOLERANCE_V


def test_local_mode_before_the_last_write_is_no_evidence() -> None:
    """After acknowledged writes, a wrong read-back is judged by the sensor as before."""
    stage = standing()
    stage.fail(InjectionKind.FLAGGED, 4, flag=DeviceFlag.LOCAL_MODE)
    stage.run(1.5)
    stage.do(rq.Resume())
    stage.run(0.1)
    before_v = stage.x.drive_v
    stage.channels.writes.clear()
    stage.fail(InjectionKind.READ_BACK_OFFSET, value=-before_v)
    stage.cycle()
    blind = stage.state
    stage.until("RAMP")
    stage.cycle()

    assert blind == State.BLIND
    assert written_v(stage)[0] == pytest.approx(before_v, abs=SLEW_STEP_V)


@given(position_um=st.floats(6.0, 24.0), share=st.floats(0.0, 1.0), truly=st.booleans())
@settings(max_examples=5)
def test_no_read_back_makes_a_step(position_um: float, share: float, truly: bool) -> None:
    """It may be wrong by any factor, or true after a loss of power: no write is far away.

    A wrong read-back within the tolerance, or one that is not a collapse, is another fault.
    """
    stage = standing(position_um)
    output_v = stage.x.drive_v
    if truly:
        stage.device.deactivate(stage.t_ns)
        stage.device.activate(stage.t_ns)
        output_v = 0.0
    else:
        stage.fail(InjectionKind.READ_BACK_OFFSET, value=(share - 1.0) * output_v)
    stage.run(0.15)
    stage.do(rq.Stop())
    stage.run(0.3)
    steps_v = [abs(a - b) for a, b in pairwise([output_v, *written_v(stage)])]

    assert max(steps_v, default=0.0) <= SLEW_STEP_V + TOLERANCE_V
    assert stage.state in {State.FAULT, State.SAFE, State.RAMP}


def test_arming_at_a_voltage_that_the_sensor_excludes_is_refused() -> None:
    """The first write would make a step. A person may answer for the read-back."""
    stage = FaultyStage()
    stage.channels.write([90.0], 0)
    stage.fail(InjectionKind.READ_BACK_OFFSET, value=-90.0)
    stage.run(0.1)
    stage.channels.writes.clear()
    refused = stage.ask(rq.Arm())
    written = list(stage.channels.writes)
    accepted = stage.ask(rq.Arm(confirm_output=True))

    assert "sensor 16.7" in refused.why
    assert (refused.accepted, written, accepted.accepted) == (False, [], True)


@pytest.mark.fault("A3")
@pytest.mark.fault("D10")
@pytest.mark.parametrize(
    "wrong",
    [(InjectionKind.STUCK_OUTPUT, 600, {}), (InjectionKind.READ_BACK_OFFSET, 30, {"value": 4.0})],
    ids=["stuck output", "read-back"],
)
def test_output_that_was_elsewhere_leaves_an_unknown_memory(
    wrong: tuple[InjectionKind, int, dict[str, float]],
) -> None:
    """The memory has followed voltages that the stage may not have had: conditioning mends it."""
    stage = SwingingStage(Mode.FEEDFORWARD)
    kind, cycles, what = wrong
    stage.fail(kind, cycles, **what)
    stage.until("FAULT")
    stage.run(1.1)
    stage.do(rq.Reset(), rq.Arm())
    stage.cycle()
    shown = ids(stage.records[-1].present)
    refused = stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE))
    stage.do(rq.Condition())
    stage.until("READY")
    stage.do(rq.SelectMode(mode=Mode.ADAPTIVE))
    stage.run(0.1)

    assert Fault.A3 in stage.faults()
    assert Fault.D10 in shown
    assert "the hysteresis is unknown" in refused.why
    assert (stage.x.mode, ids(stage.records[-1].present)) == (Mode.ADAPTIVE, [])
