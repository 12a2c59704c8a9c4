"""Each process of a stage is killed, in each state."""

import os
import signal

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
    assert stage.daemon.exit_code() == 74
    left_v = stage.writes()[-1].drive_v

    stage.daemon.start()
    status = stage.daemon.until("FAULT", 90.0)

    assert left_v > SAFE_V
    assert latched(status) == ["P2"]
    assert stage.writes()[-1].drive_v == SAFE_V
    assert_gentle(stage.writes(), LATE_S)


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

    assert code == 74
    assert "UNKNOWN" in text
    assert again.returncode == 0, again.stderr
    assert stage.writes()[-1].drive_v == SAFE_V
    stage.assert_ended()
