"""How long a movement still takes, as its records tell."""

from math import isnan

import pytest

from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.messages import requests as rq
from tests.control.rig_stage import RigStage, quick_config


@pytest.fixture
def stage() -> RigStage:
    """Return a stage that is ready to move."""
    stage = RigStage(quick_config())
    stage.cycle()
    stage.do(rq.Arm())
    stage.do(rq.SelectMode(mode=Mode.FEEDFORWARD))
    return stage


def remaining_s(stage: RigStage) -> float:
    """Return the remaining time of the newest record."""
    return stage.records[-1].axes[0].remaining_s


def test_command_is_at_its_target_after_the_remaining_time(stage: RigStage) -> None:
    """The time counts down to 0 with the clock, however slow the movement is."""
    stage.do(rq.Goto(position_um=10.0, speed_um_per_s=20.0))
    stage.cycle()
    start_s = remaining_s(stage)
    stage.run(start_s / 2)
    half_s = remaining_s(stage)
    before = stage.records[-1].axes[0]
    stage.run(half_s + 0.01)
    after = stage.records[-1].axes[0]

    assert start_s > 10.0 / 20.0  # minimum jerk takes longer than way / speed
    assert half_s == pytest.approx(start_s / 2, abs=0.02)
    assert before.command_um != before.target_um
    assert after.command_um == pytest.approx(10.0)
    assert after.remaining_s == 0.0


def test_waveform_remains_for_its_duration(stage: RigStage) -> None:
    """The way to its start counts, too."""
    sine = Sine(kind="sine", low=2.0, high=8.0, frequency_hz=5.0)
    stage.do(rq.Wave(command_um={"x": sine}, duration_s=3.0))
    stage.cycle()

    assert remaining_s(stage) > 2.9


def test_without_a_target_no_time_remains(stage: RigStage) -> None:
    """A stream has no end, and neither has a voltage that is held."""
    stage.do(rq.Goto(position_um=10.0, speed_um_per_s=20.0))
    stage.do(rq.Hold())
    stage.cycle()
    held_s = remaining_s(stage)
    stage.do(rq.Resume())
    stage.do(rq.Stream(axes=("x",)))
    stage.cycle()

    assert isnan(held_s)
    assert isnan(remaining_s(stage))
