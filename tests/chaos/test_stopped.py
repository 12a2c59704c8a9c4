"""A process of a moving stage is stopped for a while, as by a debugger or a busy machine."""

import os
import signal
import time
from itertools import pairwise

import pytest

from piezod.units import NS_PER_S
from tests.chaos.conftest import LATE_S, ChaosStage
from tests.daemon.hosted_stage import SLEW_V_PER_S
from tests.daemon.waiting import eventually
from tests.hosted_rig import Write

pytestmark = pytest.mark.chaos

PERIOD_S = 1.0 / 20.0
STEP_V = SLEW_V_PER_S * (PERIOD_S + LATE_S)
"""Largest step of two writes, also after a gap: that of a cycle, and of one that came late."""
BURST = 2
"""So many writes may come before their cycle: the one that was on its way, and a late one."""


def stop_for(pid: int, duration_s: float) -> int:
    """Stop a process, and let it go on after a time; return that instant, in ns."""
    os.kill(pid, signal.SIGSTOP)
    end_s = time.monotonic() + duration_s
    try:
        eventually(lambda: time.monotonic() >= end_s)
    finally:
        os.kill(pid, signal.SIGCONT)
    return time.monotonic_ns()


def write_after(stage: ChaosStage, t_ns: int) -> bool:
    """Return whether a stage has written later than a second after an instant."""
    return stage.writes()[-1].asked_ns > t_ns + NS_PER_S


def assert_paced(writes: list[Write]) -> None:
    """Assert that no step is above the slew limit, and that no burst makes up for lost cycles."""
    for one, next_one in pairwise(writes):
        assert abs(next_one.drive_v - one.drive_v) <= STEP_V + 1e-6, (one, next_one)
    for first, write in enumerate(writes):
        later = writes[first : first + 40]
        for count, each in enumerate(later):
            elapsed_s = (each.asked_ns - write.asked_ns) / NS_PER_S
            assert count <= elapsed_s / PERIOD_S + BURST, (write, each)


@pytest.mark.parametrize("stop_s", [0.03, 0.3])
@pytest.mark.fault("L1")
def test_loop_that_is_stopped_below_a_second_moves_on(stage: ChaosStage, stop_s: float) -> None:
    """The lost periods are counted, and the stage moves on by itself, without a larger step."""
    daemon = stage.daemon
    stage.bring("RUN")
    skipped, first = daemon.status()["skipped_cycles"], len(stage.writes())
    end_ns = stop_for(stage.loop_pid, stop_s)
    eventually(lambda: write_after(stage, end_ns))
    status, log = daemon.status(), daemon.text
    daemon.do("shutdown")

    assert status["state"] == "RUN"
    assert "fault=L5" not in log
    assert status["skipped_cycles"] - skipped >= int(stop_s / PERIOD_S) - 1
    assert daemon.exit_code() == 0, daemon.text
    assert_paced(stage.writes()[first - 1 :])
    stage.assert_ended()


@pytest.mark.fault("L5")
def test_loop_that_is_stopped_for_longer_holds_the_stage(stage: ChaosStage) -> None:
    """Nothing moves on by itself: the stage is held, and ramped down when nobody resumes."""
    daemon = stage.daemon
    stage.bring("RUN")
    first, pid = len(stage.writes()), stage.loop_pid
    stop_for(pid, 1.5)
    eventually(lambda: "fault=L5" in daemon.text)
    daemon.until("SAFE")
    log, loop_pid = daemon.text, daemon.loop_pid
    daemon.do("shutdown")

    assert "RUN to HOLD" in log
    assert "HOLD to RAMP" in log
    assert loop_pid == pid
    assert daemon.exit_code() == 0, daemon.text
    assert_paced(stage.writes()[first - 1 :])
    stage.assert_ended()


@pytest.mark.fault("H1")
def test_supervisor_that_is_stopped_for_less_than_three_seconds_changes_nothing(
    stage: ChaosStage,
) -> None:
    """The loop moves the stage on meanwhile, and the supervisor does not take it for hung."""
    daemon = stage.daemon
    stage.bring("RUN")
    first, pid = len(stage.writes()), stage.loop_pid
    end_ns = stop_for(daemon.process.pid, 2.0)
    moved = [write for write in stage.writes()[first:] if write.asked_ns < end_ns]
    eventually(lambda: write_after(stage, end_ns))
    status, log, loop_pid = daemon.status(), daemon.text, daemon.loop_pid
    daemon.do("shutdown")

    assert status["state"] == "RUN"
    assert loop_pid == pid
    assert "fault=H1" not in log
    assert "fault=L3" not in log
    assert len(moved) > 1.0 / PERIOD_S
    assert daemon.exit_code() == 0, daemon.text
    assert_paced(stage.writes()[first - 1 :])
    stage.assert_ended()
