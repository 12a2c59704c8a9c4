"""How long a movement takes, as the stage tells it at once, and how long it still takes."""

from math import isnan

import pytest

from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.control.stage.answer import Answer
from piezod.messages import requests as rq
from piezod.units import NS_PER_S
from tests.control.rig_stage import RigStage, quick_config


@pytest.fixture
def running() -> RigStage:
    """Return a stage in RUN."""
    return RigStage().armed(rq.SelectMode(mode=Mode.TRIMMED))


def taken_s(stage: RigStage, answer: Answer) -> float:
    """Run until an accepted movement is on target; return how long that has taken, in s."""
    assert answer.accepted
    start_ns = stage.t_ns - stage.period_ns
    while not stage.x.on_target:
        stage.cycle()
    return (stage.t_ns - start_ns) / NS_PER_S


@pytest.mark.parametrize("speed_um_per_s", [None, 4.0])
def test_goto_tells_how_long_it_takes(running: RigStage, speed_um_per_s: float | None) -> None:
    """An axis that follows well is on target when the answer says, at any speed."""
    answer = running.ask(rq.Goto(position_um=9.0, speed_um_per_s=speed_um_per_s))

    assert taken_s(running, answer) == pytest.approx(answer.duration_s, abs=0.1)


def test_wave_tells_how_long_it_takes(running: RigStage) -> None:
    """The way to its start counts, and the waveform itself."""
    sine = Sine(kind="sine", low=8.0, high=9.0, frequency_hz=2.0)
    answer = running.ask(rq.Wave(command_um={"x": sine}, duration_s=1.5))

    assert answer.duration_s > 1.5
    assert taken_s(running, answer) == pytest.approx(answer.duration_s, abs=0.1)


def test_what_starts_no_movement_takes_no_time(running: RigStage) -> None:
    """A hold and a refused movement have no duration."""
    assert running.ask(rq.Goto(position_um=1e4)).duration_s == 0.0
    assert running.ask(rq.Hold()).duration_s == 0.0


@pytest.fixture
def stage() -> RigStage:
    """Return a stage that is ready to move."""
    stage = RigStage(quick_config()).armed()
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
