"""Tests of bus faults, from the first cycle to the reaction of the stage."""

from functools import cache
from itertools import pairwise
from math import isfinite

import pytest

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.faults.table import ids
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
from tests.control.rig_stage import FaultyStage

CASES = [
    FaultCase("B1", InjectionKind.LOST, {"flag": DeviceFlag.DISCONNECTED}, State.BLIND, 1),
    FaultCase("B2", InjectionKind.FLAGGED, {"flag": DeviceFlag.OTHER_PATH}, State.BLIND, 1),
    FaultCase("B3", InjectionKind.FLAGGED, {"flag": DeviceFlag.GARBAGE}, State.HOLD, 5),
    FaultCase("B4", InjectionKind.FLAGGED, {"flag": DeviceFlag.BAD_CHECKSUM}, State.HOLD, 5),
    FaultCase("B5", InjectionKind.FLAGGED, {"flag": DeviceFlag.LATE_REPLY}, State.HOLD, 5),
    FaultCase("B6", InjectionKind.FLAGGED, {"flag": DeviceFlag.OUT_OF_ORDER}, State.HOLD, 5),
    FaultCase("B7", InjectionKind.FLAGGED, {"flag": DeviceFlag.SLOW_REPLY}, State.HOLD, 5),
    FaultCase("B8", InjectionKind.LOST, {"flag": DeviceFlag.BUS_OFF}, State.BLIND, 1),
    FaultCase("B9", InjectionKind.FLAGGED, {"flag": DeviceFlag.NOT_SENT}, State.BLIND, 3),
    FaultCase("B10", InjectionKind.FLAGGED, {"flag": DeviceFlag.DEVICE_FAILURE}, State.RAMP, 1),
    FaultCase(
        "B10", InjectionKind.FLAGGED, {"flag": DeviceFlag.WRONG_REQUEST}, State.HOLD, 1, "request"
    ),
    FaultCase("B10", InjectionKind.FLAGGED, {"flag": DeviceFlag.BUSY}, State.HOLD, 5, "busy"),
    FaultCase("B11", InjectionKind.FLAGGED, {"flag": DeviceFlag.BUS_OVERLOADED}, State.HOLD, 5),
    FaultCase("B12", InjectionKind.FLAGGED, {"flag": DeviceFlag.FOREIGN_FRAME}, State.HOLD, 1),
    FaultCase("B13", InjectionKind.LOST, {"flag": DeviceFlag.HALF_OPEN}, State.BLIND, 1),
    FaultCase("B14", InjectionKind.FLAGGED, {"flag": DeviceFlag.PORT_SHARED}, State.BLIND, 1),
    FaultCase("B15", InjectionKind.LOST, {"flag": DeviceFlag.STUCK}, State.BLIND, 1),
    FaultCase("A2", InjectionKind.FLAGGED, {"flag": DeviceFlag.PARTIAL_WRITE}, State.BLIND, 5),
    FaultCase("S10", InjectionKind.FLAGGED, {"flag": DeviceFlag.OTHER_DEVICE}, State.BLIND, 1),
    FaultCase(
        "S10",
        InjectionKind.SENSOR_FLAGGED,
        {"flag": DeviceFlag.OTHER_DEVICE},
        State.RAMP,
        1,
        "sensor",
    ),
]
PARAMETERS = [
    pytest.param(one, marks=pytest.mark.fault(one.fault), id=f"{one.fault}{one.name}")
    for one in CASES
]


@cache
def result_of(case: FaultCase) -> tuple[SwingingStage, list[CycleRecord]]:
    """Return the result of `run_case`, computed once for each case."""
    return run_case(case)


@pytest.mark.parametrize("case", PARAMETERS)
def test_bus_fault_leads_to_its_state_in_time_and_to_rest(
    case: FaultCase, reaction: Reaction
) -> None:
    """The fault is reported, the stage leaves RUN within the bound, and ends at rest."""
    check_course(case, *result_of(case), reaction)


@pytest.mark.parametrize("case", PARAMETERS)
def test_limits_hold_after_a_bus_fault(case: FaultCase) -> None:
    """No write leaves the range or moves faster than the slew rate."""
    stage, _ = result_of(case)

    writes = stage.channels.writes
    assert all(isfinite(drive_v) and 0.0 <= drive_v <= 150.0 for _, (drive_v,) in writes)
    for (before_ns, (before_v,)), (t_ns, (drive_v,)) in pairwise(writes):
        periods = (t_ns - before_ns) // stage.period_ns
        assert abs(drive_v - before_v) <= SLEW_STEP_V * periods


@pytest.mark.parametrize(
    ("flag", "fault"), [(DeviceFlag.DISCONNECTED, "B1"), (DeviceFlag.STUCK, "B15")]
)
def test_nothing_is_sent_in_blind_and_nothing_caught_up(flag: DeviceFlag, fault: str) -> None:
    """The first write afterwards is one small step away from the voltage in force."""
    stage = SwingingStage()
    while stage.x.drive_v < 60.0:
        stage.cycle()
    stage.fail(InjectionKind.LOST, 60, flag=flag)
    stage.run(0.01)
    stage.channels.writes.clear()
    stage.run(0.28)
    sent = len(stage.channels.writes)
    stage.until("RAMP")
    in_force_v = stage.x.read_back_v
    stage.run(0.01)

    assert fault in stage.faults()
    assert sent == 0
    (_, (first_v,)), *_ = stage.channels.writes
    assert abs(first_v - in_force_v) < 1.1  # a ramp takes 1 V in a cycle


@pytest.mark.fault("B1")
@pytest.mark.parametrize("reads_back", [True, False])
def test_output_that_was_not_driven_is_not_driven_after_blind(reads_back: bool) -> None:
    """A cable may be pulled while the stage is disarmed: no write follows."""
    stage = FaultyStage(reads_back=reads_back)
    stage.run(0.1)
    stage.device.write([33.0], stage.t_ns)
    stage.fail(InjectionKind.LOST, 100, flag=DeviceFlag.DISCONNECTED)
    stage.run(0.05)
    blind = stage.state
    stage.until("FAULT")
    stage.run(1.5)
    stage.do(rq.Reset())

    assert blind == State.BLIND
    assert stage.state == State.SAFE
    assert stage.channels.writes == []


@pytest.mark.fault("B1")
def test_lost_sensor_holds_and_then_ramps_without_blind() -> None:
    """The lost device is reported once; the missing samples are its consequence."""
    stage = SwingingStage()
    stage.fail(InjectionKind.DROPPED, 400)
    stage.fail(InjectionKind.SENSOR_FLAGGED, 400, flag=DeviceFlag.DISCONNECTED)
    after = stage.run(3.5)

    states = [record.state for record in after]
    assert set(stage.faults()) == {"B1"}
    assert states[1] is State.HOLD
    assert 200 <= states.index(State.RAMP) <= 203
    assert State.BLIND not in states
    assert stage.state == State.FAULT
    assert stage.x.drive_v == pytest.approx(0.0, abs=0.5)


@pytest.mark.fault("B1")
def test_amplifier_that_is_lost_after_the_sensor_is_blind() -> None:
    """It is the same fault in a more severe case."""
    stage = SwingingStage()
    stage.fail(InjectionKind.SENSOR_FLAGGED, 100, flag=DeviceFlag.DISCONNECTED)
    stage.run(0.05)
    held = stage.state
    stage.fail(InjectionKind.LOST, 100, flag=DeviceFlag.DISCONNECTED)
    stage.run(0.01)

    assert (held, stage.state) == (State.HOLD, State.BLIND)


@pytest.mark.fault("B5")
@pytest.mark.fault("S5")
def test_missing_replies_hold_once_and_can_be_resumed() -> None:
    """The missing sample is detected before the bus fault, and does not hold a second time."""
    stage = SwingingStage()
    stage.fail(InjectionKind.DROPPED, 60)
    stage.fail(InjectionKind.SENSOR_FLAGGED, 60, flag=DeviceFlag.LATE_REPLY)
    after = stage.run(0.5)
    stage.do(rq.Resume())

    assert stage.faults() == ["S5", "B5"]
    assert {record.state for record in after} == {State.RUN, State.HOLD}
    assert stage.state == State.RUN


@pytest.mark.fault("B3")
def test_single_bad_frame_is_shown_without_event_and_reaction() -> None:
    """It is shown as long as any other fault."""
    stage = SwingingStage()
    stage.fail(InjectionKind.FLAGGED, 1, flag=DeviceFlag.GARBAGE)
    after = stage.run(0.5)

    assert ids(after[0].present) == ["B3"]
    assert ids(after[-1].present) == []
    assert stage.faults() == []
    assert {record.state for record in after} == {State.RUN}


@pytest.mark.fault("B4")
def test_single_bad_frames_do_not_prolong_a_fault() -> None:
    """A fault whose cause now appears only now and then can be resumed."""
    stage = SwingingStage()
    stage.fail(InjectionKind.FLAGGED, 10, flag=DeviceFlag.BAD_CHECKSUM)
    stage.run(0.05)
    for _ in range(6):
        stage.fail(InjectionKind.FLAGGED, 1, flag=DeviceFlag.BAD_CHECKSUM)
        stage.run(0.05)
    stage.do(rq.Resume())

    assert stage.state == State.RUN


@pytest.mark.fault("A10")
def test_missing_read_back_is_shown_while_driven() -> None:
    """It is neither a problem nor an event."""
    stage = SwingingStage(Mode.FEEDFORWARD, reads_back=False)
    driven = ids(stage.records[-1].present)
    stage.do(rq.Stop())
    stage.until("SAFE")
    stage.run(0.1)

    assert driven == ["A10"]
    assert ids(stage.records[-1].present) == []
    assert stage.faults() == []


@pytest.mark.fault("A10")
def test_held_output_without_read_back_is_ramped_from_the_last_write() -> None:
    """The write was acknowledged, and the amplifier would have reported a restart."""
    stage = SwingingStage(Mode.FEEDFORWARD, holds=True, reads_back=False, tells_restart=True)
    while stage.x.drive_v < 60.0:
        stage.cycle()
    stage.fail(InjectionKind.LOST, 50, flag=DeviceFlag.DISCONNECTED)
    before_v = stage.x.in_force_v
    stage.run(0.01)
    blind = stage.state
    stage.channels.writes.clear()
    stage.until("FAULT")

    (_, (first_v,)), *_, (_, (last_v,)) = stage.channels.writes
    assert blind == State.BLIND
    assert first_v == pytest.approx(before_v, abs=0.5)
    assert last_v == 0.0


@pytest.mark.fault("A10")
@pytest.mark.parametrize(
    ("holds", "tells_restart", "reported_flag", "fault"),
    [
        (False, True, None, "B1"),
        (True, False, None, "B1"),
        (True, True, DeviceFlag.RESTARTED, "A7"),
        (True, True, DeviceFlag.WATCHDOG_TRIPPED, "A9"),
        (True, True, DeviceFlag.LOCAL_MODE, "A8"),
    ],
)
def test_unknown_output_is_not_ramped(
    holds: bool, tells_restart: bool, reported_flag: DeviceFlag | None, fault: str
) -> None:
    """It is not held, reports no restart, or reported a move: FAULT, a remedy, and no write."""
    stage = SwingingStage(
        Mode.FEEDFORWARD, holds=holds, reads_back=False, tells_restart=tells_restart
    )
    stage.fail(InjectionKind.LOST, 50, flag=DeviceFlag.DISCONNECTED)
    stage.run(0.255)
    if reported_flag is not None:
        stage.fail(InjectionKind.FLAGGED, 1, flag=reported_flag)
    stage.channels.writes.clear()
    stage.until("FAULT")
    stage.run(1.5)
    texts = [event.text for event in stage.events if event.kind == "output"]
    stage.do(rq.Reset())
    refused, confirmed = stage.ask(rq.Arm()), stage.ask(rq.Arm(confirm_output=True))

    assert {fault, "B1"} == set(stage.faults()) & {"A7", "A8", "A9", "B1"}
    assert len(texts) == 1
    assert "--confirm-output" in texts[0]
    assert stage.channels.writes[0][1] == (0.0,)
    assert (refused.accepted, confirmed.accepted) == (False, True)


@pytest.mark.fault("A1")
def test_amplifier_that_may_have_been_off_does_not_get_its_old_voltage() -> None:
    """Without read-back and restart flag it may be at 0 V after some refusals."""
    stage = SwingingStage(Mode.FEEDFORWARD, holds=True, reads_back=False)
    while stage.x.drive_v < 60.0:
        stage.cycle()
    stage.fail(InjectionKind.REFUSED, 10)
    stage.run(0.05)
    blind = stage.state
    stage.channels.writes.clear()
    stage.until("FAULT")
    stage.run(0.5)

    assert blind == State.BLIND
    assert stage.channels.writes == []
    assert len(stage.output_lost_ns) == 1  # `piezod safe` does not begin there either
