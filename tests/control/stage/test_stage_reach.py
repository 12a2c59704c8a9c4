"""Tests of commands that model and drive limits cannot reach, and of a drive that is limited."""

from math import isnan

import pytest

from piezod.config.axes import LimitsConfig
from piezod.config.daemon import DaemonConfig
from piezod.config.drive_limits import DriveLimit
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.control.assembly import check_stage, stage_warnings
from piezod.errors import ModelError
from piezod.hysteresis import LearnedModel
from piezod.messages import requests as rq
from tests.control.rig_stage import RigStage, quick_config, with_axis
from tests.control.surface_rig import EACH_MODEL, with_model

WIDE_UM = (-5.0, 260.0)


def with_range(
    model: str = "stops",
    range_um: tuple[float, float] | None = WIDE_UM,
    limits: LimitsConfig | None = None,
) -> DaemonConfig:
    """Return a configuration with another range of commands, or none."""
    config = with_model(quick_config(), model)
    return with_axis(config, command_range_um=range_um, limits=limits or config.axes["x"].limits)


def armed(config: DaemonConfig, mode: Mode = Mode.FEEDFORWARD) -> RigStage:
    """Return a stage in READY."""
    return RigStage(config).armed(rq.SelectMode(mode=mode))


def sine(low_um: float, high_um: float) -> rq.Wave:
    """Return a wave over a range."""
    wave = Sine(kind="sine", low=low_um, high=high_um, frequency_hz=1.0)
    return rq.Wave(command_um={"x": wave}, duration_s=2.0)


@pytest.mark.parametrize("model", EACH_MODEL)
@pytest.mark.parametrize("mode", list(Mode))
def test_command_that_cannot_be_reached_is_refused_with_the_range_that_can(
    model: str, mode: Mode
) -> None:
    """A configured range that is too wide does not help, whatever the mode and the motion."""
    stage = armed(with_range(model), mode)
    low_um, high_um = stage.stage.axes[0].motion_limits[2:]

    refused = [
        stage.ask(request)
        for request in (
            rq.Goto(position_um=100.0),
            rq.Goto(position_um=-1.0),
            sine(1.0, high_um + 1.0),
            sine(-1.0, 20.0),
        )
    ]

    assert not any(answer.accepted for answer in refused)
    assert all(f"{low_um:g} to {high_um:g} µm" in answer.why for answer in refused)
    assert low_um == pytest.approx(0.0, abs=1e-6)
    assert stage.ask(rq.Goto(position_um=0.95 * high_um)).accepted


def test_setpoints_that_cannot_be_reached_are_ignored() -> None:
    """A stream stays where it was."""
    stage = armed(with_range())
    stage.do(rq.Stream(axes=("x",)))
    for setpoint_um in (5.0, 100.0):
        for _ in range(100):
            stage.controller.stream_um(0, setpoint_um, stage.t_ns)
            stage.cycle()

    commands_um = [record.axes[0].command_um for record in stage.records]
    assert max(each for each in commands_um if not isnan(each)) <= 5.0 + 1e-9


def test_narrower_limits_narrow_the_range() -> None:
    """The model holds to 150 V; half a volt per mille less makes the range shorter."""
    limits = quick_config().axes["x"].limits
    low_um, high_um = RigStage(with_range(range_um=None)).stage.axes[0].motion_limits[2:]
    less = limits.model_copy(update={"drive_max_v": 0.985 * limits.drive_max_v})

    reach_um = RigStage(with_range(limits=less)).stage.axes[0].motion_limits[2:]

    assert reach_um[0] == low_um
    assert 0.97 * high_um < reach_um[1] < 0.999 * high_um


def test_range_that_is_too_wide_is_told() -> None:
    """Once by `check`, and as an event at the start; the shipped range fits."""
    stage = RigStage(with_range())
    stage.cycle()
    (text,) = stage_warnings(with_range())

    assert "-5 to 260 µm" in text
    assert [event.text for event in stage.events if event.kind == "range"] == [text]
    assert stage_warnings(quick_config()) == ()
    assert stage_warnings(with_range(range_um=None)) == ()


def test_range_without_any_position_that_can_be_reached_is_refused() -> None:
    """The stage does not start with it."""
    with pytest.raises(ModelError, match=r"^axis x: no position of command_range_um"):
        check_stage(with_range(range_um=(100.0, 260.0)))


def test_limited_drive_shows_in_the_record_from_its_first_cycle_on() -> None:
    """The slew rate limits a fast wave, and the range a stage whose gain was learned to be less."""
    stage = armed(with_range(range_um=None))
    before = stage.x.limited
    stage.do(
        rq.Wave(
            command_um={"x": Sine(kind="sine", low=0.0, high=25.0, frequency_hz=20.0)},
            duration_s=1.0,
        )
    )
    fast = {record.axes[0].limited for record in stage.run(1.0)}
    law = stage.stage.axes[0].law
    law.compensator.restart(LearnedModel(law.proof.first.weights.copy(), offset=-0.04))
    high_um = stage.stage.axes[0].motion_limits.high_um
    stage.do(rq.Goto(position_um=high_um, speed_um_per_s=20.0))
    first = next(
        i for i, record in enumerate(stage.run(3.0)) if record.axes[0].limited is DriveLimit.RANGE
    )

    assert before is DriveLimit.NONE
    assert fast == {DriveLimit.NONE, DriveLimit.SLEW}
    assert first > 0
