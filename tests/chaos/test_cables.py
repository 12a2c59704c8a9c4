"""The rig goes away in each state, and another process takes its place."""

import os
import signal
from pathlib import Path

import pytest

from tests.chaos.conftest import LATE_S, MakeStage, mortal_rig
from tests.daemon.daemons import Daemon
from tests.daemon.hosted_stage import GAIN_ERROR_V, SLEW_V_PER_S, assert_gentle
from tests.daemon.waiting import eventually
from tests.hosted_rig import writes

pytestmark = pytest.mark.chaos

REST = {"SAFE", "FAULT"}
LOST = {"S5", "A1", "B1", "B15"}
"""Faults by which a stage without its rig can be noticed; which comes first is chance."""


def has_noticed(daemon: Daemon) -> bool:
    """Return whether a stage has noticed the loss, and writes nothing any more.

    It is BLIND; but if nothing is driven and the missing samples are noticed first, it is FAULT.
    """
    status = daemon.status()
    present = {fault["id"] for fault in status.get("faults", ())}
    return status.get("state") in {"BLIND", "FAULT"} and bool(present & LOST)


@pytest.mark.parametrize(
    "state", ["SAFE", "READY", "RUN", "IDENT", "HOLD", "RAMP", "ESTOP", "FAULT"]
)
def test_socket_that_is_closed_under_the_driver(
    make_stage: MakeStage, tmp_path: Path, state: str
) -> None:
    """The stage writes nothing without its rig; from the new one's read-back it goes on gently.

    It comes to rest, in SAFE or in FAULT. After a reset it is SAFE, and ends in order.
    """
    stage = make_stage()
    daemon = stage.daemon
    stage.bring(state)
    os.kill(stage.rig.pid, signal.SIGKILL)
    eventually(lambda: has_noticed(daemon), 60.0)
    (tmp_path / "rig.sock").unlink(missing_ok=True)
    with mortal_rig(tmp_path / "rig.sock", tmp_path / "second.csv"):
        eventually(lambda: daemon.status().get("state") in REST, 60.0)
        eventually(lambda: daemon.ask("POST", "reset", {"engineer": True}).status_code == 200, 60.0)
        daemon.until("SAFE")
        daemon.do("shutdown")
        code = daemon.exit_code()
        second = writes(tmp_path / "second.csv")

    assert code == 0, daemon.text
    assert_gentle(stage.writes(), LATE_S)
    assert_gentle(second, LATE_S)
    # The new rig is at 0 V.
    assert not second or second[0].drive_v <= GAIN_ERROR_V + SLEW_V_PER_S / 20.0
