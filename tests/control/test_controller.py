"""Tests of a stage from arming to shutdown: the effect and the refusal of each request."""

import numpy as np
import pytest

from piezod.config.model_file import load_model
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Sine, Triangle
from piezod.messages import requests as rq
from tests.conftest import Reaction
from tests.control.rig_stage import (
    CONFIG,
    RigStage,
    cycles_until,
    has_left_run,
    quick_config,
    shipped_config,
    with_axis,
)

SINE = Sine(kind="sine", low=0.0, high=20.0, frequency_hz=1.0)


@pytest.fixture
def stage() -> RigStage:
    """Return the stage of the repository, after its first cycle."""
    rig_stage = RigStage()
    rig_stage.cycle()
    return rig_stage


@pytest.fixture
def quick_stage() -> RigStage:
    """Return a stage that ramps and conditions quickly, after its first cycle."""
    rig_stage = RigStage(quick_config())
    rig_stage.cycle()
    return rig_stage


def running(stage: RigStage, mode: Mode = Mode.FEEDFORWARD) -> RigStage:
    """Arm a stage and run it."""
    stage.do(rq.Arm(), rq.SelectMode(mode=mode))
    return stage


def test_healthy_stage_starts_disarmed_and_writes_nothing(stage: RigStage) -> None:
    """The first cycle passes the self-test; SAFE writes nothing for a second."""
    stage.run(1.0)

    assert stage.state == State.SAFE
    assert stage.channels.writes == []


@pytest.mark.parametrize("mode", list(Mode))
def test_position_is_reached_in_every_mode(stage: RigStage, mode: Mode) -> None:
    """Compensated within 1 % of the travel, uncompensated within the hysteresis."""
    running(stage, mode).do(rq.Goto(position_um=12.5))
    stage.run(1.0)

    assert stage.x.command_um == 12.5
    assert stage.x.position_um == pytest.approx(
        12.5, abs=4.0 if mode is Mode.UNCOMPENSATED else 0.3
    )
    assert stage.x.on_target is (mode is not Mode.UNCOMPENSATED)


def test_goto_in_ready_runs_in_the_selected_mode(stage: RigStage) -> None:
    """A mode that is selected in SAFE is used later."""
    stage.do(rq.SelectMode(mode=Mode.ADAPTIVE), rq.Arm(), rq.Goto(position_um=5.0))

    assert (stage.state, stage.x.mode) == (State.RUN, Mode.ADAPTIVE)


def test_each_movement_has_a_number(stage: RigStage) -> None:
    """A waiting client sees by the number that another movement has started."""
    running(stage)
    first = stage.ask(rq.Goto(position_um=5.0))
    second = stage.ask(rq.Goto(position_um=6.0))

    assert second.motion == first.motion + 1 == stage.x.motion


def test_change_of_mode_in_run_does_not_jump(stage: RigStage) -> None:
    """The drive moves by at most 2 V per cycle."""
    running(stage).do(rq.Goto(position_um=12.5))
    stage.run(1.0)
    records = []
    for mode in (Mode.ADAPTIVE, Mode.UNCOMPENSATED, Mode.CLOSED, Mode.TRIMMED, Mode.FEEDFORWARD):
        stage.do(rq.SelectMode(mode=mode))
        records += stage.run(0.5)

    drive_v = np.array([record.axes[0].drive_v for record in records])
    assert np.max(np.abs(np.diff(drive_v))) < 2.0


def test_waveform_is_followed_and_its_end_is_held(stage: RigStage) -> None:
    """The motion from the present position to its start comes first."""
    running(stage).do(rq.Goto(position_um=12.5))
    stage.run(0.5)
    stage.do(rq.Wave(command_um={"x": SINE}, duration_s=2.25))
    records = stage.run(4.0)

    command_um = np.array([record.axes[0].command_um for record in records])
    position_um = np.array([record.axes[0].position_um for record in records])
    assert command_um.max() == pytest.approx(20.0, abs=0.01)
    assert command_um[-1] == pytest.approx(10.0)
    assert np.max(np.abs(np.diff(command_um))) < 1.25
    assert np.max(np.abs(position_um - command_um)) < 0.5


def test_stream_is_followed_until_it_stops(stage: RigStage) -> None:
    """0.1 s after the last setpoint the voltage is held."""
    running(stage).do(rq.Stream(axes=("x",)))
    for k in range(50):
        stage.controller.stream_um(0, 0.1 * k, stage.t_ns)
        stage.run(0.01)
    reached_um = stage.x.position_um
    stage.controller.stream_um(0, 99.0, stage.t_ns)  # out of range: ignored
    stage.run(0.15)

    assert reached_um == pytest.approx(4.9, abs=0.3)
    assert stage.state == State.HOLD
    assert any(event.kind == "stream" for event in stage.events)


def test_requested_hold_does_not_expire_and_resume_does_not_jump(stage: RigStage) -> None:
    """The hold lasts 5 s; after it the stage resumes from the held voltage."""
    running(stage).do(rq.Wave(command_um={"x": SINE}, duration_s=100.0))
    stage.run(0.3)
    stage.do(rq.Hold())
    held = stage.run(5.0)
    held_v = {record.axes[0].drive_v for record in held}
    stage.do(rq.Resume())
    resumed = stage.run(0.2)

    assert (len(held_v), held[-1].state) == (1, State.HOLD)
    assert stage.state == State.RUN
    assert resumed[-1].axes[0].drive_v == pytest.approx(held_v.pop(), abs=1.0)


@pytest.mark.parametrize("request_", [rq.Stop(), rq.Disarm()])
def test_stopping_ramps_to_the_safe_voltage(stage: RigStage, request_: rq.Request) -> None:
    """The ramp has the configured 50 V/s and ends at the safe voltage within 1 mV."""
    running(stage).do(rq.Goto(position_um=20.0))
    stage.run(1.0)
    from_v, from_ns = stage.x.drive_v, stage.t_ns
    stage.do(request_)
    stage.until("SAFE")

    last_v = stage.channels.writes[-1][1][0]
    assert last_v == pytest.approx(0.0, abs=1e-3)
    assert (stage.t_ns - from_ns) / 1e9 == pytest.approx(from_v / 50.0, rel=0.02)


@pytest.mark.parametrize("state", ["SAFE", "READY", "RUN", "HOLD", "IDENT", "RAMP", "ESTOP"])
def test_shutdown_ends_at_the_safe_voltage_from_every_state(
    quick_stage: RigStage, state: str
) -> None:
    """The state before does not matter."""
    stage = quick_stage
    if state != "SAFE":
        running(stage).do(rq.Goto(position_um=20.0))
        stage.run(0.3)
    match state:
        case "READY":
            stage.do(rq.Stop())
            stage.until("SAFE")
            stage.do(rq.Arm())
        case "HOLD":
            stage.do(rq.Hold())
        case "IDENT":
            stage.do(rq.Stop())
            stage.until("SAFE")
            stage.do(rq.Arm(), rq.Condition())
            stage.run(0.15)
        case "RAMP":
            stage.do(rq.Stop())
        case "ESTOP":
            stage.do(rq.Estop())
    assert stage.state == state
    stage.do(rq.Shutdown())
    stage.until("STOPPING")

    assert stage.controller.finished
    assert stage.output_v == pytest.approx(0.0, abs=0.5)


@pytest.mark.fault("E1")
def test_emergency_stop_ramps_latches_and_needs_a_reset(
    quick_stage: RigStage, reaction: Reaction
) -> None:
    """ESTOP lasts to the safe voltage, then FAULT refuses to arm; a reset leads to SAFE."""
    stage = quick_stage
    running(stage).do(rq.Goto(position_um=20.0))
    stage.run(0.5)
    stage.do(rq.Estop())
    reaction("E1", cycles=cycles_until(stage.records[-1:], has_left_run))
    refused = stage.ask(rq.Goto(position_um=1.0))
    stage.until("FAULT")
    too_early = stage.ask(rq.Arm())
    stage.run(1.5)
    stage.do(rq.Reset(), rq.Arm())

    assert not refused.accepted
    assert not too_early.accepted
    assert "E1" in stage.faults()
    assert stage.state == State.READY


@pytest.mark.fault("E1")
def test_emergency_stop_cuts_if_configured() -> None:
    """The amplifier switches its output off instead of ramping."""
    config = shipped_config()
    safety = config.axes["x"].safety.model_copy(update={"estop": "cut"})
    stage = RigStage(with_axis(config, safety=safety))
    stage.cycle()
    running(stage).do(rq.Goto(position_um=20.0))
    stage.run(0.5)
    stage.do(rq.Estop())
    stage.run(0.05)

    assert stage.output_v < 1.0


def test_conditioning_makes_the_memory_known() -> None:
    """Before it, adaptive modes are refused; its swing covers the range and ends at rest."""
    swing = shipped_config().axes["x"].conditioning.model_copy(update={"frequency_hz": 5.0})
    stage = RigStage(with_axis(shipped_config(), conditioning=swing), memory_known=False).armed()
    refused = stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE))
    stage.do(rq.Condition())
    records = stage.run(1.8)
    stage.until("READY")
    stage.do(rq.SelectMode(mode=Mode.ADAPTIVE))

    drive_v = [record.axes[0].drive_v for record in records]
    assert not refused.accepted
    assert "condition" in refused.why
    assert max(drive_v) == pytest.approx(150.0, abs=1e-3)
    assert stage.state == State.RUN


def test_arming_conditions_if_configured() -> None:
    """`arm` leads to IDENT and then to READY."""
    config = quick_config()
    swing = config.axes["x"].conditioning.model_copy(update={"on_arm": True})
    stage = RigStage(with_axis(config, conditioning=swing)).armed()
    during = stage.state
    stage.until("READY", within_s=20.0)

    assert during == State.IDENT


def test_identification_drives_the_waveform_from_rest_to_rest(stage: RigStage) -> None:
    """Every voltage is recorded; READY follows."""
    triangle = Triangle(kind="triangle", low=0.0, high=100.0, frequency_hz=1.0)
    stage.do(rq.Arm(), rq.Identify(drive_v={"x": triangle}, duration_s=1.5))
    records = stage.run(1.6)
    stage.until("READY")

    drive_v = [record.axes[0].drive_v for record in records]
    assert max(drive_v) == pytest.approx(100.0)
    assert stage.x.drive_v == pytest.approx(0.0, abs=1e-6)


def test_identification_beyond_the_limits_is_refused(stage: RigStage) -> None:
    """The refusal names the allowed range."""
    triangle = Triangle(kind="triangle", low=0.0, high=151.0, frequency_hz=1.0)
    stage.do(rq.Arm())
    answer = stage.ask(rq.Identify(drive_v={"x": triangle}, duration_s=1.5))

    assert answer.why == ("axis x: drive_v out of range (got 0 to 151 V), allowed range 0 to 150 V")


def test_sensor_is_zeroed_at_rest(stage: RigStage) -> None:
    """The zero is the mean of the samples."""
    stage.do(rq.Zero())
    stage.run(0.3)
    after_um = [record.axes[0].position_um for record in stage.run(0.5)]

    assert np.mean(after_um) == pytest.approx(0.0, abs=0.01)
    assert stage.controller.learned(0).zero_um != 0.0


def test_sensor_is_not_zeroed_in_run(stage: RigStage) -> None:
    """The refusal names the allowed states."""
    running(stage).do(rq.Goto(position_um=5.0))
    stage.run(0.5)
    answer = stage.ask(rq.Zero())

    assert answer.why == "the stage is in RUN; a sensor can be zeroed in SAFE or READY"


def test_model_is_adopted_while_disarmed(stage: RigStage) -> None:
    """The axis starts from its weights; while armed, the request is refused."""
    file = load_model(CONFIG.parent / "models" / "simulated-stack.yaml")
    scaled = tuple(1.01 * weight for weight in file.right_stop_weights)
    model = file.model_copy(update={"right_stop_weights": scaled})
    stage.do(rq.AdoptModel(model=model, zero_um=0.25), rq.Arm())
    answer = stage.ask(rq.AdoptModel(model=file))

    learned = stage.controller.learned(0)
    assert learned.weights[len(scaled) :] == pytest.approx(scaled)
    assert learned.zero_um == 0.25
    assert (
        answer.why == "the stage is in READY; a model can be changed in SAFE: `piezod disarm` first"
    )


def test_model_of_unscaled_data_is_not_adopted(stage: RigStage) -> None:
    """The stage keeps its model; the answer has the voltages of the model and of the limits."""
    file = load_model(CONFIG.parent / "models" / "simulated-stack.yaml")
    kept = stage.controller.learned(0).weights

    answer = stage.ask(rq.AdoptModel(model=file.model_copy(update={"drive_high_v": 5.0})))

    assert "to 5 V, 3.3 % of the limits of the axis, 0 to 150 V" in answer.why
    assert stage.controller.learned(0).weights == pytest.approx(kept)


def test_shadow_computes_everything_and_writes_nothing(stage: RigStage) -> None:
    """The state is RUN and voltages are computed, but nothing is written."""
    stage.do(rq.Arm(shadow=True), rq.Goto(position_um=12.5))
    records = stage.run(1.0)
    stage.do(rq.Stop())
    stage.until("SAFE")

    assert records[-1].shadow
    assert records[-1].axes[0].drive_v > 50.0
    assert stage.channels.writes == []


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        (
            rq.Goto(position_um=26.5),
            "position out of range (got 26.5 µm), allowed range 0 to 26 µm",
        ),
        (
            rq.Goto(position_um=26.0000001),
            "position out of range (got 26.0000001 µm), allowed range 0 to 26 µm",
        ),
        (rq.Goto(position_um=1.0, axis="y"), "no axis 'y'; this stage has x"),
        (
            rq.Wave(
                command_um={"x": Sine(kind="sine", low=0, high=30, frequency_hz=1)}, duration_s=1
            ),
            "position out of range (got 0 to 30 µm), allowed range 0 to 26 µm",
        ),
        (rq.Stream(axes=("z",)), "no axis 'z'; this stage has x"),
    ],
)
@pytest.mark.fault("C10")
def test_commands_out_of_range_are_refused_and_move_nothing(
    stage: RigStage, request_: rq.Request, why: str
) -> None:
    """They are refused, not clamped; the stage stays READY."""
    stage.do(rq.Arm())
    answer = stage.ask(request_)

    assert (answer.accepted, answer.why, stage.state) == (False, why, State.READY)
    assert answer.out_of_range == ("range" in why)


@pytest.mark.fault("C13")
@pytest.mark.parametrize(
    "request_",
    [
        rq.Goto(position_um=1.0),
        rq.SelectMode(mode=Mode.FEEDFORWARD),
        rq.Wave(command_um={"x": SINE}, duration_s=1.0),
        rq.Stream(axes=("x",)),
        rq.Condition(),
        rq.Resume(),
    ],
)
def test_nothing_moves_a_latched_stage(stage: RigStage, request_: rq.Request) -> None:
    """After an emergency stop only a reset has an effect."""
    stage.do(rq.Arm(), rq.Estop())
    stage.until("FAULT")
    stage.channels.writes.clear()
    answer = stage.ask(request_)
    stage.run(0.5)

    assert not answer.accepted
    assert stage.channels.writes == []
