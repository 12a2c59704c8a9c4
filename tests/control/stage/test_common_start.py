"""Two stages that begin a waveform at the same instant, in virtual time."""

import re

import pytest

from piezod.messages import requests as rq
from tests.control.rig_stage import RigStage, shipped_config
from tests.control.stage.test_stage_play import PLAY, PlayedByHand, PlayingStage

WAIT_S = 0.4
RISE = {"kind": "triangle", "low": 2.0, "high": 12.0, "frequency_hz": 2.0}


def wave(start_s: float) -> rq.Wave:
    """Return a request for a rise from 2 µm."""
    fields = {"command_um": {"x": RISE}, "duration_s": 0.4, "start_s": start_s}
    return rq.Wave.model_validate(fields)


def armed(rate_hz: float, begins_ns: int) -> RigStage:
    """Return an armed stage whose loop has begun at an instant."""
    stage = RigStage(shipped_config().model_copy(update={"rate_hz": rate_hz}))
    stage.t_ns = begins_ns
    stage.until("SAFE")
    stage.do(rq.Arm())
    return stage


def first_rise_ns(stage: RigStage) -> int:
    """Return the instant of the last cycle whose command is at the start of the rise."""
    at_start = [each.t_ns for each in stage.records if abs(each.axes[0].command_um - 2.0) < 1e-9]
    return at_start[-1]


def test_waveforms_begin_within_one_period() -> None:
    """Loops of other phases and rates leave the start of the waveform within one period."""
    stages = [armed(1000.0, 0), armed(1000.0, 370_000), armed(400.0, 110_000)]
    now_ns = max(stage.t_ns for stage in stages)
    start_ns = now_ns + round(WAIT_S * 1e9)
    for stage in stages:
        stage.do(wave(start_ns / 1e9))
        stage.run(2 * WAIT_S)

    off_ns = [first_rise_ns(stage) - start_ns for stage in stages]
    periods_ns = [stage.period_ns for stage in stages]
    assert all(-period_ns <= off <= 0 for off, period_ns in zip(off_ns, periods_ns, strict=True))


@pytest.mark.parametrize(
    ("ahead_s", "why"),
    [
        (-0.5, r"start_s has passed, 0\.5 s ago: choose a later start"),
        (0.01, r"too early \(got 0\.01 s ahead\): the axis needs 0\.\d+ s to go to the beginning"),
        (30.5, r"too far ahead \(got 30\.5 s\), allowed: at most 30 s"),
    ],
)
def test_start_that_cannot_be_kept_is_refused(ahead_s: float, why: str) -> None:
    """The stage does not move, and stays in its state."""
    stage = armed(1000.0, 10**10)
    answer = stage.ask(wave(stage.t_ns / 1e9 + ahead_s))

    assert not answer.accepted
    assert re.search(why, answer.why)
    assert stage.state == "READY"


def test_play_gets_its_instant() -> None:
    """The device is ramped to the first voltage at once, and is told when to start."""
    stage = PlayingStage(start_s=5.0)

    assert stage.t_ns < 4 * 10**9
    assert stage.runner.tables[0].start_ns == 5 * 10**9


def test_play_that_cannot_be_ready_is_refused() -> None:
    """The ramp to the first voltage takes longer than there is time."""
    stage = RigStage(plays=PlayedByHand()).armed()
    answer = stage.ask(PLAY.model_copy(update={"start_s": stage.t_ns / 1e9 + 0.1}))

    assert "the axis needs 0.4 s to go to the beginning" in answer.why
    assert stage.state == "READY"
