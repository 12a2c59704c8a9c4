"""Plays of devices behind a worker: what was read before their end counts no more."""

from collections.abc import Iterator
from itertools import pairwise
from math import isnan, nan
from threading import Event

import pytest

from piezod.control.stage.playing import PlayOutcome
from piezod.messages import requests as rq
from tests.daemon.loop.play_stage import BENCHES, MS, PLAY, PlayStage
from tests.daemon.waiting import eventually

ABORT_V = 75.0
STEP_V = 10.0
"""More than a step of the ramp at the safe voltage, with its first cycles; less than any jump."""


@pytest.fixture(params=BENCHES)
def stage(request: pytest.FixtureRequest) -> Iterator[PlayStage]:
    """Return an armed stage with each player in turn."""
    stage = PlayStage(request.param)
    yield stage
    stage.close()


def assert_no_jump(stage: PlayStage, from_v: float) -> None:
    """Assert that no write was far from the voltage in force, and that the output is at rest."""
    steps_v = [from_v, *(drive_v for (drive_v,) in stage.bench.rig.driven_v)]
    assert max(abs(b - a) for a, b in pairwise(steps_v)) < STEP_V
    assert stage.in_force_v == pytest.approx(0.0, abs=0.5)


def test_a_stopped_play_is_ramped_down_from_where_it_stopped(stage: PlayStage) -> None:
    """Not from a voltage of before the play; there is no fault but the unknown memory."""
    stage.play_to(ABORT_V)
    stage.stop_play()
    stage.bench.rig.driven_v.clear()
    stopped_v = stage.in_force_v
    stage.until("SAFE")

    assert stopped_v > ABORT_V
    assert_no_jump(stage, stopped_v)
    assert set(stage.faults()) <= {"D10"}


def test_an_unknown_end_is_ramped_down_from_a_later_read_back(stage: PlayStage) -> None:
    """The runner reports no voltage, and the worker still has a round of before the play."""
    stage.play_to(ABORT_V)
    stage.stop_play()
    stage.runner.end = PlayOutcome((nan,))
    stage.bench.rig.driven_v.clear()
    stopped_v = stage.in_force_v
    stage.until("SAFE")

    assert_no_jump(stage, stopped_v)


def test_a_stage_is_not_safe_while_nobody_knows_its_voltage(stage: PlayStage) -> None:
    """An abort is lost on a silent line, so the stage is blind; then it ramps down by itself."""
    stage.play_to(ABORT_V)
    stage.silence(silent=True)
    lost_v = stage.stop_play()
    stage.until("BLIND")
    stage.do(rq.Stop())
    noted = [event.text for event in stage.events if event.kind == "stop"]
    stage.bench.rig.driven_v.clear()
    stage.silence(silent=False)
    first_v = stage.in_force_v
    stage.until_down()

    assert isnan(lost_v)
    assert {"A1", "B1"} & set(stage.faults())
    assert noted
    assert_no_jump(stage, first_v)


def test_one_lost_abort_is_repeated(stage: PlayStage) -> None:
    """The line is back at once: the play is stopped by a later round, and nobody is blind long."""
    stage.play_to(ABORT_V)
    stage.silence(silent=True)
    stage.stop_play()
    stage.bench.rig.driven_v.clear()
    first_v = stage.in_force_v
    stage.silence(silent=False)
    stage.until_down()

    assert_no_jump(stage, first_v)
    assert sum(event.text.endswith("to BLIND") for event in stage.events) <= 1


def test_a_play_whose_cable_was_pulled_is_stopped_when_it_is_back(stage: PlayStage) -> None:
    """The stage is blind, and then ramps down from the voltage at which the play was found."""
    stage.play_to(ABORT_V)
    stage.pull(pulled=True)
    lost_v = stage.stop_play()
    stage.until("BLIND")
    stage.bench.wait(100 * MS)
    stage.bench.rig.driven_v.clear()
    stage.pull(pulled=False)
    found_v = stage.in_force_v
    stage.until("FAULT")

    assert isnan(lost_v)
    assert found_v > ABORT_V
    assert_no_jump(stage, found_v)


def test_an_emergency_stop_of_a_blind_stage_is_carried_out_later(stage: PlayStage) -> None:
    """It is noted, and the outputs ramp down as soon as the abort is confirmed."""
    stage.play_to(ABORT_V)
    stage.silence(silent=True)
    stage.stop_play()
    stage.until("BLIND")
    stage.do(rq.Estop())
    stage.silence(silent=False)
    stage.until("ESTOP")
    stage.until("FAULT")

    assert any(event.kind == "estop" for event in stage.events)
    assert stage.in_force_v == pytest.approx(0.0, abs=0.5)


def test_a_play_is_asked_for_while_a_round_is_under_way(stage: PlayStage) -> None:
    """The loop sends nothing for that: the line belongs to the worker."""
    free, waits = Event(), Event()

    def block(reply: bytes) -> bytes:
        waits.set()
        assert free.wait(20.0)
        return reply

    stage.blocked = waits.is_set
    stage.bench.line.change = block
    stage.cycle()
    sent = len(stage.bench.line.sent)
    answer = stage.controller.execute(PLAY, stage.t_ns)
    after = len(stage.bench.line.sent)
    stage.silence(silent=False)
    free.set()
    eventually(lambda: stage.worker.idle)

    assert answer.accepted, answer.why
    assert after == sent
    assert "P4" not in stage.faults()
