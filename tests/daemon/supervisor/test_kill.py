"""Processes are killed at random moments: the stage always goes to its safe voltage, gently."""

import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import Reaction
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import latched
from tests.daemon.hosted_stage import SAFE_V, HostedStage, assert_gentle
from tests.daemon.waiting import eventually
from tests.forked import STARTS_RESCUER
from tests.hosted_rig import hosted

VICTIMS = ("loop", "supervisor", "supervisor, then safe", "both, then safe", "both")
KILLS_IN_SHORT = 5  # each victim once, one of them during its ramp
KILLS = [
    pytest.param(number, marks=[] if number < KILLS_IN_SHORT else pytest.mark.stress)
    for number in range(200)
]


@pytest.fixture
def stage(tmp_path: Path, start: StartDaemon) -> Iterator[HostedStage]:
    """Return a stage that is at rest; it starts its rescuer as a program."""
    with hosted(tmp_path / "rig.sock", tmp_path / "trace.csv"):
        yield HostedStage(tmp_path, start, **{STARTS_RESCUER: ""})


@pytest.mark.fault("P2")
@pytest.mark.parametrize("number", KILLS)
def test_killed(stage: HostedStage, number: int, reaction: Reaction) -> None:
    """The writes keep to range and slew rate, and end at the safe voltage."""
    draw = random.Random(number)  # noqa: S311 - reproducible, not secret
    stage.run()
    stage.wait_for_writes(draw.randrange(40))
    if draw.random() < 0.2:  # kill during a ramp
        stage.ramp_for(draw.randrange(10))

    driven, killed_ns = len(stage.writes()), time.monotonic_ns()
    victim = VICTIMS[number % len(VICTIMS)]
    stage.kill(victim)

    trace = stage.writes()
    if victim == "loop" and len(trace) > driven:
        first_ns = next(write.asked_ns for write in trace if write.pid != stage.loop_pid)
        reaction("P2", ms=(first_ns - killed_ns) / 1e6)
    assert_gentle(trace)
    assert trace[-1].drive_v == SAFE_V
    assert stage.in_force_v() == pytest.approx(SAFE_V, abs=0.5)


@pytest.mark.fault("P2")
def test_restart_brings_the_rig_to_its_safe_voltage_first(stage: HostedStage) -> None:
    """If nothing ramped down before, the next daemon does, and latches P2."""
    stage.run()
    stage.wait_for_writes(15)
    stage.kill_rescuer()
    stage.kill("both")
    left_v = stage.in_force_v()
    stage.daemon.start()
    status = stage.daemon.until("FAULT", 90.0)
    # On a busy machine the rig may not answer in the very first cycle.
    drive_v = eventually(lambda: stage.daemon.status()["axes"]["x"]["drive_v"], 20.0)
    ended_v = stage.writes()[-1].drive_v
    refused = stage.daemon.ask("POST", "arm", {}).status_code

    assert left_v > SAFE_V + 5
    assert ended_v == SAFE_V
    assert drive_v == pytest.approx(SAFE_V, abs=0.5)
    assert latched(status) == ["P2"]
    assert refused == 409

    stage.loop_pid = stage.daemon.loop_pid
    stage.run()
    stage.daemon.do("stop")
    stage.daemon.until("SAFE")

    assert_gentle(stage.writes())
    assert stage.writes()[-1].drive_v == SAFE_V
