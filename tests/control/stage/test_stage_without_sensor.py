"""Tests of axes without a sensor."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.config.daemon import DaemonConfig
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Setpoint, Sine
from piezod.messages import requests as rq
from piezod.testing.injections import InjectionKind
from tests.control.rig_stage import FaultyStage, RigStage, quick_config, shipped_config, with_axis

TARGETS_UM = st.lists(st.floats(0.0, 26.0), min_size=1, max_size=3)


def open_loop(config: DaemonConfig | None = None) -> DaemonConfig:
    """Return a configuration without its sensor."""
    return with_axis(config or quick_config(), sensor=None)


@given(targets_um=TARGETS_UM, mode=st.sampled_from([Mode.FEEDFORWARD, Mode.UNCOMPENSATED]))
@settings(max_examples=10)
def test_cycle_is_that_of_a_stage_with_a_sensor(targets_um: list[float], mode: Mode) -> None:
    """Modes that do not need the sensor write the same voltages, to the last bit."""
    stages = RigStage(quick_config()).armed(), RigStage(open_loop()).armed()
    for stage in stages:
        stage.do(rq.SelectMode(mode=mode))
        for target_um in targets_um:
            stage.do(rq.Goto(position_um=target_um))
            stage.run(0.05)
        stage.do(rq.Stop())
    with_sensor, without = ([record.axes[0].drive_v for record in one.records] for one in stages)

    assert without == with_sensor


def test_stage_without_sensor_has_no_fault_of_a_sensor() -> None:
    """It conditions, moves, follows a waveform and ramps down; its position is not available."""
    stage = RigStage(open_loop()).armed()
    sine = Sine(kind="sine", low=2.0, high=20.0, frequency_hz=5.0)
    stage.do(rq.Condition())
    stage.until("READY")
    stage.do(rq.Goto(position_um=12.0))
    stage.run(0.3)
    stage.do(rq.Wave(command_um={"x": sine}, duration_s=0.4))
    stage.run(0.5)
    stage.do(rq.Stop())
    stage.until("SAFE")
    positions_um = [record.axes[0].position_um for record in stage.records]

    assert stage.faults() == []
    assert all(position_um != position_um for position_um in positions_um)  # noqa: PLR0124 - NaN
    assert not any(record.axes[0].on_target for record in stage.records)


@pytest.mark.parametrize(
    ("request_", "what"),
    [
        (rq.SelectMode(mode=Mode.ADAPTIVE), "mode adaptive"),
        (rq.SelectMode(mode=Mode.TRIMMED, axis="x"), "mode trimmed"),
        (rq.SelectMode(mode=Mode.CLOSED, axis="x"), "mode closed"),
        (rq.Zero(), "zeroing"),
        (
            rq.Identify(drive_v={"x": Setpoint(kind="setpoint", level=3.0)}, duration_s=1.0),
            "the identification",
        ),
    ],
)
def test_requests_that_need_a_sensor_are_refused(request_: rq.Request, what: str) -> None:
    """It is refused, and nothing moves."""
    stage = RigStage(open_loop()).armed()
    answer = stage.ask(request_)

    assert not answer.accepted
    assert answer.why.startswith(f"{what} needs a sensor, and axis x has none: configure one")
    assert stage.state == State.READY


def test_axis_beside_it_may_adapt() -> None:
    """Only the axes that a request names must have a sensor."""
    one = quick_config()
    config = one.model_copy(update={"axes": {"x": one.axes["x"], "z": open_loop().axes["x"]}})
    stage = RigStage(config).armed()
    everything = stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE))
    stage.run(0.1)
    stage.do(rq.SelectMode(mode=Mode.ADAPTIVE, axis="x"))

    assert "axis z has none" in everything.why
    assert [axis.mode for axis in stage.stage.axes] == [Mode.ADAPTIVE, Mode.FEEDFORWARD]


@pytest.mark.fault("A7")
def test_without_a_sensor_a_collapsed_read_back_is_not_believed() -> None:
    """Nothing else shows the fall, so that the voltage is unknown: nothing is written."""
    stage = FaultyStage(open_loop(shipped_config())).armed(rq.Goto(position_um=18.0))
    stage.run(0.5)
    stage.channels.writes.clear()
    stage.fail(InjectionKind.READ_BACK_OFFSET, value=-stage.x.drive_v)
    stage.until("FAULT")
    stage.run(1.5)
    stage.do(rq.Reset())
    refused = stage.ask(rq.Arm())
    written = list(stage.channels.writes)
    confirmed = stage.ask(rq.Arm(confirm_output=True))

    assert (written, refused.accepted, confirmed.accepted) == ([], False, True)
