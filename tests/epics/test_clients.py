"""Clients by others read, write and monitor the IOC of a real daemon."""

from collections.abc import Iterator

import pytest

from tests.daemon.daemons import Daemon
from tests.daemon.waiting import eventually
from tests.epics.processes import Ioc, Peer, peer, run_client

pytestmark = pytest.mark.epics
LIBRARIES = ("p4p", "aioca", "caproto")


@pytest.fixture(params=LIBRARIES)
def client(request: pytest.FixtureRequest, ioc: Ioc) -> Iterator[Peer]:
    """Return a client of each library."""
    with peer(request.param, ioc.environ) as client:
        yield client


@pytest.fixture
def armed(client: Peer, daemon: Daemon) -> Peer:
    """Return a client of the armed stage, in mode trimmed."""
    if daemon.status()["state"] != "RUN":
        daemon.ask("POST", "stop", {})
        daemon.until("SAFE")
        assert client.put("rig:ARM", 1) == ""
        daemon.until("READY")
        assert client.put("rig:x:MODE", 3) == ""
    daemon.until("RUN")
    return client


def test_client_reads_values_with_units_and_limits(client: Peer, daemon: Daemon) -> None:
    """Position and setpoint have units, digits and limits; text arrives as text."""
    setpoint = client.get("rig:x.VAL")
    position = client.get("rig:x:POS")

    assert (setpoint["unit"], setpoint["digits"]) == ("um", 4)
    assert (setpoint["low"], setpoint["high"]) == (0.0, 26.0)
    assert (position["unit"], position["digits"], position["severity"]) == ("um", 4, 0)
    assert position["value"] == pytest.approx(daemon.status()["axes"]["x"]["position_um"], abs=0.5)
    assert client.value("rig:LOOP:RATE") == 100.0
    assert client.get("rig:x.VELO")["unit"] == "um/s"


def test_client_moves_and_waits(armed: Peer) -> None:
    """A write with completion ends on target; monitors have seen the movement begin and end."""
    armed.watch("rig:x.DMOV")
    armed.watch("rig:x.RBV")
    armed.put("rig:x.VAL", 2.0)
    refused = armed.put("rig:x.VAL", 9.0)

    assert refused == ""
    assert armed.value("rig:x.DMOV") == 1
    assert armed.value("rig:x.RBV") == pytest.approx(9.0, abs=0.3)
    eventually(lambda: armed.value("rig:x:ONTARGET") == 1)
    eventually(lambda: [each["value"] for each in armed.seen("rig:x.DMOV")][-2:] == [0, 1])
    positions = [each["value"] for each in armed.seen("rig:x.RBV")]
    assert min(positions) < 4.0
    assert max(positions) > 8.0


def test_write_beyond_the_limits_is_refused(armed: Peer) -> None:
    """The record keeps its value and has an alarm, until the next write that is accepted."""
    assert armed.put("rig:x.VAL", 6.0) == ""
    armed.put("rig:x.VAL", 26.5)
    after = armed.get("rig:x.VAL")

    assert (after["value"], after["severity"]) == (6.0, 2)
    assert armed.value("rig:x.LVIO") == 1
    eventually(lambda: "allowed range 0 to 26 um" in armed.value("rig:MESSAGE"))
    assert armed.put("rig:x.VAL", 6.5) == ""
    assert armed.get("rig:x.VAL")["severity"] == 0
    armed.put("rig:x.VELO", 1e6)
    armed.put("rig:x.RBV", 1e6)
    assert armed.value("rig:x.VELO") == 200.0
    assert armed.value("rig:x.RBV") < 26.0
    assert armed.value("rig:x:WAVE:FREQ") == 1.0
    armed.put("rig:x:WAVE:FREQ", -1.0)
    assert armed.value("rig:x:WAVE:FREQ") == 1.0


def test_refusal_of_the_daemon_is_an_alarm(client: Peer, daemon: Daemon) -> None:
    """A stage that is not armed does not move: the record gets its value back, and an alarm."""
    daemon.ask("POST", "stop", {})
    daemon.until("SAFE")
    eventually(lambda: client.value("rig:STATE") == 1)
    before = client.value("rig:x.VAL")
    client.put("rig:x.VAL", 3.0)

    eventually(lambda: client.get("rig:x.VAL")["severity"] == 2)
    assert client.value("rig:x.VAL") == before
    eventually(lambda: "cannot move in SAFE" in client.value("rig:MESSAGE"))
    assert client.put("rig:RESUME", 1) == ""
    eventually(lambda: client.get("rig:RESUME")["severity"] == 2)


def test_stage_is_commanded(armed: Peer, daemon: Daemon) -> None:
    """Hold, resume, wave, recording, stop and emergency stop arrive at the daemon."""
    assert armed.put("rig:HOLD", 1) == ""
    daemon.until("HOLD")
    eventually(lambda: armed.get("rig:STATE")["severity"] == 1)
    assert armed.put("rig:RESUME", 1) == ""
    daemon.until("RUN")
    for name, value in (("LOW", 2.0), ("HIGH", 4.0), ("FREQ", 2.0), ("DURATION", 1.0)):
        assert armed.put(f"rig:x:WAVE:{name}", value) == ""
    assert armed.put("rig:REC:LABEL", "scan") == ""
    assert armed.put("rig:REC:START", 1) == ""
    assert armed.put("rig:x:WAVE:START", 1) == ""
    eventually(lambda: armed.value("rig:REC:RUNNING") == 1)
    assert armed.value("rig:REC:NAME").endswith("-scan")
    eventually(lambda: max(each or 0.0 for each in armed.value("rig:x:HIST:CMD")) > 3.9)
    assert len(armed.value("rig:x:HIST:POS")) == len(armed.value("rig:x:HIST:DRIVE")) > 10
    eventually(lambda: armed.value("rig:x.DMOV") == 1)
    assert armed.put("rig:REC:STOP", 1) == ""
    assert armed.put("rig:x:WAVE:TABLE", [1.0, 1.5, 1.0]) == ""
    assert armed.put("rig:x:WAVE:KIND", 2) == ""
    assert armed.put("rig:x:WAVE:START", 1) == ""
    assert armed.put("rig:x:WAVE:KIND", 0) == ""
    assert armed.put("rig:STOP", 1) == ""
    daemon.until("SAFE")
    assert armed.put("rig:ESTOP", 1) == ""
    eventually(lambda: "E1" in armed.value("rig:FAULTS"))
    assert armed.get("rig:FAULT:ESTOP")["severity"] == 2
    eventually(lambda: armed.put("rig:RESET", 1) == "" and daemon.status()["state"] == "SAFE")
    eventually(lambda: "E1" not in armed.value("rig:FAULTS"))
    assert armed.put("rig:LEASE", 1) == ""
    eventually(lambda: armed.value("rig:LEASE:HOLDER").endswith("ioc"))
    assert armed.put("rig:LEASE", 0) == ""
    eventually(lambda: armed.value("rig:LEASE:HOLDER") == "")


def test_epics_motor_of_ophyd(ioc: Ioc, daemon: Daemon) -> None:
    """It finds limits and units, moves, refuses what is beyond the limits, stops, and goes on."""
    daemon.ask("POST", "stop", {})
    daemon.until("SAFE")
    with peer("aioca", ioc.environ) as client:
        client.put("rig:ARM", 1)
        client.put("rig:x:MODE", 3)
    report = run_client("ophyd", ioc.environ, "rig:x")

    assert report["limits"] == [0.0, 26.0]
    assert (report["unit"], report["digits"]) == ("um", 4)
    assert [success for success, _ in report["reached"]] == [True] * 4
    reached = [position for _, position in report["reached"]]
    assert reached == pytest.approx([5.0, 12.5, 12.5, 3.0], abs=0.3)
    assert report["limits refused"] == "LimitError"
    assert report["stopped"] is False
    assert report["moves after stop"] is True
