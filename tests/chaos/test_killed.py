"""Each process of a stage is killed or stopped, in each state."""

import os
import signal
import time

import pytest

from tests.chaos.conftest import LATE_S, ChaosStage
from tests.daemon.daemons import latched
from tests.daemon.hosted_stage import SAFE_V, assert_gentle
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.chaos

STATES = ("SAFE", "READY", "RUN", "IDENT", "HOLD", "RAMP", "ESTOP", "FAULT")
VICTIMS = ("loop", "supervisor", "both, then safe")


@pytest.mark.fault("P2")
@pytest.mark.parametrize("victim", VICTIMS)
@pytest.mark.parametrize("state", STATES)
def test_stage_ends_at_its_safe_voltage(stage: ChaosStage, state: str, victim: str) -> None:
    """Whichever process dies in whichever state, the voltage goes gently to the safe one."""
    stage.bring(state)

    stage.kill(victim)

    stage.assert_ended()
    if writes := stage.writes():
        assert writes[-1].drive_v == SAFE_V or state in {"SAFE", "FAULT"}


@pytest.mark.fault("P2")
def test_ramp_down_that_is_killed_is_done_by_the_next_start(stage: ChaosStage) -> None:
    """`piezod safe` dies during its ramp: the next daemon ramps on, from where it is."""
    stage.bring("RUN")
    os.kill(stage.loop_pid, signal.SIGKILL)
    driver = stage.writes()[-1].pid
    eventually(lambda: stage.writes()[-1].pid != driver, 60.0)
    os.kill(stage.writes()[-1].pid, signal.SIGKILL)
    assert stage.daemon.exit_code() == 1
    left_v = stage.writes()[-1].drive_v

    stage.daemon.start()
    status = stage.daemon.until("FAULT", 90.0)

    assert left_v > SAFE_V
    assert latched(status) == ["P2"]
    assert stage.writes()[-1].drive_v == SAFE_V
    assert_gentle(stage.writes(), LATE_S)


@pytest.mark.parametrize("stopped", ["loop", "supervisor", "rig", "loop and supervisor"])
@pytest.mark.parametrize("stop_s", [0.3, 5.0])
@pytest.mark.fault("L5")
def test_process_that_stands_still(stage: ChaosStage, stopped: str, stop_s: float) -> None:
    """A process that is stopped for a while leads to a state that the documentation describes.

    After a short stop the daemon goes on. After a long one the other process has done what it does
    for a dead one.
    """
    stage.bring("RUN")
    pids = {
        "loop": [stage.loop_pid],
        "supervisor": [stage.daemon.process.pid],
        "rig": [stage.rig.pid],
        "loop and supervisor": [stage.loop_pid, stage.daemon.process.pid],
    }[stopped]
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(stop_s)
    for pid in pids:
        if pid != stage.loop_pid or stage.daemon.loop_pid:
            _go_on(pid)

    if stop_s > 1.0 and stopped in {"loop", "supervisor"}:
        assert stage.daemon.exit_code() == 1
        assert stage.writes()[-1].drive_v == SAFE_V
        stage.assert_ended()
        return
    calm = {"RUN", "SAFE", "FAULT"}
    eventually(lambda: stage.daemon.status().get("state") in calm, 60.0)
    stage.daemon.do("shutdown")
    assert stage.daemon.exit_code() == 0, stage.daemon.text
    stage.assert_ended()


def _go_on(pid: int) -> None:
    try:
        os.kill(pid, signal.SIGCONT)
    except ProcessLookupError:  # it was killed meanwhile
        return


@pytest.mark.fault("A1")
def test_loop_that_dies_while_the_rig_stands_still(stage: ChaosStage) -> None:
    """Nobody knows the voltage then, and `piezod safe` says so; it works when the rig answers."""
    stage.bring("RUN")
    os.kill(stage.rig.pid, signal.SIGSTOP)
    try:
        stage.daemon.until("BLIND")
        os.kill(stage.loop_pid, signal.SIGKILL)
        code = stage.daemon.exit_code(180.0)
    finally:
        os.kill(stage.rig.pid, signal.SIGCONT)
    text = stage.daemon.text

    again = stage.daemon.command("safe", str(stage.daemon.config), "--unless-clean")

    assert code == 1
    assert "UNKNOWN" in text
    assert again.returncode == 0, again.stderr
    assert stage.writes()[-1].drive_v == SAFE_V
    stage.assert_ended()
