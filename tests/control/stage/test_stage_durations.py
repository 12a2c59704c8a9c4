"""How long a movement takes, as the stage tells it when it accepts the movement."""

import pytest

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Sine
from piezod.control.stage.answer import Answer
from piezod.messages.requests import Arm, Goto, Hold, SelectMode, Wave
from piezod.units import NS_PER_S
from tests.control.rig_stage import RigStage


@pytest.fixture
def running() -> RigStage:
    """Return a stage in RUN."""
    stage = RigStage()
    stage.until(State.SAFE)
    stage.do(Arm(), SelectMode(mode=Mode.TRIMMED))
    return stage


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
    answer = running.ask(Goto(position_um=9.0, speed_um_per_s=speed_um_per_s))

    assert taken_s(running, answer) == pytest.approx(answer.duration_s, abs=0.1)


def test_wave_tells_how_long_it_takes(running: RigStage) -> None:
    """The way to its start counts, and the waveform itself."""
    sine = Sine(kind="sine", low=8.0, high=9.0, frequency_hz=2.0)
    answer = running.ask(Wave(command_um={"x": sine}, duration_s=1.5))

    assert answer.duration_s > 1.5
    assert taken_s(running, answer) == pytest.approx(answer.duration_s, abs=0.1)


def test_what_starts_no_movement_takes_no_time(running: RigStage) -> None:
    """A hold and a refused movement have no duration."""
    assert running.ask(Goto(position_um=1e4)).duration_s == 0.0
    assert running.ask(Hold()).duration_s == 0.0
