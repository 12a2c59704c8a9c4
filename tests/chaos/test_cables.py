"""The rig goes away in each state, and another process takes its place."""

import csv
import os
import signal
from pathlib import Path

import pytest

from tests.chaos.conftest import LATE_S, MakeStage, mortal_rig
from tests.daemon.conftest import StartDaemon
from tests.daemon.hosted_stage import GAIN_ERROR_V, HIGH_V, LOW_V, SLEW_V_PER_S, assert_gentle
from tests.daemon.loop.test_pulled_cable import high_up
from tests.daemon.waiting import eventually
from tests.hosted_rig import writes

pytestmark = pytest.mark.chaos

REST = {"SAFE", "FAULT"}


@pytest.mark.parametrize(
    "state", ["SAFE", "READY", "RUN", "IDENT", "HOLD", "RAMP", "ESTOP", "FAULT"]
)
@pytest.mark.fault("A1")
def test_socket_that_is_closed_under_the_driver(
    make_stage: MakeStage, tmp_path: Path, state: str
) -> None:
    """The stage is BLIND without its rig; from the new one's read-back it goes on gently.

    After a reset the stage is SAFE, and ends in order.
    """
    stage = make_stage()
    daemon = stage.daemon
    stage.bring(state)
    os.kill(stage.rig.pid, signal.SIGKILL)
    daemon.until("BLIND", 60.0)
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


@pytest.mark.parametrize("verb", ["hold", "stop", "estop"])
@pytest.mark.fault("B1")
def test_serial_line_that_is_pulled(start: StartDaemon, tmp_path: Path, verb: str) -> None:
    """A pseudo-terminal that is closed in HOLD, RAMP and ESTOP leads to BLIND, then to rest."""
    with high_up(start, tmp_path) as (daemon, far):
        daemon.do(verb)
        far.faults("disconnect:now:2")
        daemon.until("BLIND")
        eventually(lambda: daemon.status().get("state") in REST, 60.0)
        eventually(lambda: daemon.ask("POST", "reset", {"engineer": True}).status_code == 200, 60.0)
        daemon.until("SAFE")
        daemon.do("shutdown")
        assert daemon.exit_code() == 0, daemon.text
        with (tmp_path / "trace.csv").open(encoding="ascii") as file:
            drive_v = [float(row["x_v"]) for row in csv.DictReader(file)]

    assert all(LOW_V <= each <= HIGH_V for each in drive_v)
    assert drive_v[-1] == pytest.approx(0.0, abs=0.5)
