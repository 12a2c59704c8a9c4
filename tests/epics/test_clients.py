"""Clients by others read, write and monitor the IOC of a real daemon."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from math import inf, nan

import pytest

from tests.daemon.daemons import Daemon
from tests.daemon.waiting import eventually
from tests.epics.processes import Ioc, Peer, peer

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
        client.until_taken("rig:ARM")
        daemon.until("READY")
        client.until_taken("rig:x:MODE", 3)
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
    assert armed.put("rig:x.VAL", 26.5)
    after = armed.get("rig:x.VAL")

    assert (after["value"], after["severity"]) == (6.0, 2)
    assert armed.value("rig:x.LVIO") == 1
    eventually(lambda: "allowed range 0 to 26 um" in armed.value("rig:MESSAGE"))
    assert armed.put("rig:x.VAL", 6.5) == ""
    assert armed.get("rig:x.VAL")["severity"] == 0
    assert armed.put("rig:x.VELO", 1e6)
    assert armed.value("rig:x.VELO") == 200.0
    assert armed.put("rig:x:WAVE:FREQ", 3.0) == ""
    assert armed.put("rig:x:WAVE:FREQ", -1.0)
    assert armed.value("rig:x:WAVE:FREQ") == 3.0
    eventually(lambda: "allowed range 0.0001 to 10000" in armed.value("rig:MESSAGE"))


def test_what_is_no_number_is_refused(armed: Peer) -> None:
    """NaN and infinity change nothing, and the IOC goes on."""
    assert armed.put("rig:x.VAL", 6.0) == ""
    for name in ("rig:x.VAL", "rig:x.VELO", "rig:x.TWV"):
        before = armed.value(name)
        for value in (nan, inf):
            assert armed.put(name, value), (name, value)
        assert armed.value(name) == before
    assert armed.put("rig:x.VAL", 6.5) == ""


@pytest.mark.parametrize(
    ("record", "value"),
    [
        ("x.VAL", 1e306),
        ("x.VAL", -1e308),
        ("x.VELO", 1e306),
        ("x.TWV", 1e306),
        ("x.SPMG", 9),
        ("x:MODE", 9),
        ("x:MODE", -1),
        ("LEASE", 2),
        ("x:WAVE:KIND", 7),
        ("x:WAVE:LOW", 1e306),
        ("x:WAVE:TABLE", [1.0] * 20_000),
        ("x:WAVE:TABLE", [1.0, 1e306]),
        ("x:PLAY:TABLE", [1.0] * 16_001),
        ("x:PLAY:TABLE", [1.0, nan]),
        ("x:PLAY:CYCLES", 0),
    ],
)
def test_what_a_record_cannot_be_is_refused(armed: Peer, record: str, value: object) -> None:
    """Beyond the range, too long, or no choice: the value stays, and the IOC goes on."""
    before = armed.value(f"rig:{record}")
    assert armed.put(f"rig:{record}", value)

    assert armed.value(f"rig:{record}") == before
    assert armed.put("rig:x.VAL", 6.0) == ""


def test_what_is_measured_cannot_be_written(client: Peer) -> None:
    """Records, fields that clients do not write, and what configures a record refuse each write."""
    for name in ("rig:x.RBV", "rig:x.HLM", "rig:x.DHLM", "rig:x.OFF", "rig:x:POS", "rig:STATE"):
        before = client.value(name)
        assert client.put(name, 1), name
        assert type(client.value(name)) is type(before), name
    assert client.value("rig:x.HLM") == client.value("rig:x.DHLM") == 26.0
    assert client.put("rig:ARM.NAME", "other")
    for name in ("rig:ARM.SCAN", "rig:ARM.DISP", "rig:x.DISP", "rig:x_able"):
        assert client.put(name, 1), name
        assert client.value(name) == 0


def test_write_without_completion_beyond_the_limits(armed: Peer) -> None:
    """Over PVA it fails; over CA it cannot, and alarm and message tell."""
    assert armed.put("rig:x.VAL", 6.0) == ""
    refused = armed.send("rig:x.VAL", 27.5), armed.send("rig:x:WAVE:FREQ", -1.0)

    assert [bool(each) for each in refused] == [armed.library == "p4p"] * 2
    eventually(lambda: armed.get("rig:x.VAL")["severity"] == 2)
    eventually(lambda: "allowed range" in armed.value("rig:MESSAGE"))
    assert armed.value("rig:x.VAL") == 6.0


def test_write_that_the_daemon_refuses_fails(client: Peer, daemon: Daemon) -> None:
    """A stage that is not armed does not move: the record gets its value back, and an alarm."""
    daemon.ask("POST", "stop", {})
    daemon.until("SAFE")
    eventually(lambda: client.value("rig:STATE") == 1)
    before = client.value("rig:x.VAL")
    assert client.put("rig:x.VAL", 3.0)

    assert client.get("rig:x.VAL")["severity"] == 2
    assert client.value("rig:x.VAL") == before
    eventually(lambda: "cannot move in SAFE" in client.value("rig:MESSAGE"))
    assert client.put("rig:RESUME", 1)
    assert client.get("rig:RESUME")["severity"] == 2
    assert client.put("rig:HOLD", 0) == ""


def test_write_fails_if_the_movement_does_not_reach_its_target(armed: Peer, daemon: Daemon) -> None:
    """A hold by another client on the way ends the write, with an error and an alarm."""
    assert armed.put("rig:x.VAL", 20.0) == ""
    assert armed.put("rig:x.VELO", 1.0) == ""
    with ThreadPoolExecutor() as pool:
        write = pool.submit(armed.put, "rig:x.VAL", 2.0)
        eventually(lambda: daemon.status()["axes"]["x"]["target_um"] == 2.0)
        daemon.ask("POST", "hold", {})
        assert write.result()
    assert armed.get("rig:x.VAL")["severity"] == 2
    assert armed.put("rig:x.VELO", 200.0) == ""
    assert armed.put("rig:RESUME", 1) == ""
    daemon.until("RUN")
    assert armed.put("rig:x.VAL", 5.0) == ""


def test_refused_write_on_the_way_fails_no_other_write(armed: Peer, ioc: Ioc) -> None:
    """The movement ends its own write, and a speed that was written meanwhile, without an error."""
    assert armed.put("rig:x.VAL", 20.0) == ""
    assert armed.put("rig:x.VELO", 2.0) == ""
    with peer("p4p", ioc.environ) as other, ThreadPoolExecutor() as pool:
        write = pool.submit(armed.put, "rig:x.VAL", 14.0)
        eventually(lambda: other.value("rig:x.DMOV") == 0)
        assert other.send("rig:x.VAL", 99.0)
        speed = other.put("rig:x.VELO", 200.0)
        assert (write.result(), speed) == ("", "")
    assert armed.value("rig:x.RBV") == pytest.approx(14.0, abs=0.3)


def test_write_fails_while_another_client_has_the_lease(armed: Peer, daemon: Daemon) -> None:
    """Movements, commands and modes fail, and the message says why."""
    assert armed.put("rig:LEASE", 1) == ""
    assert armed.put("rig:LEASE", 0) == ""
    eventually(lambda: daemon.ask("POST", "lease", {}).status_code == 200)
    for name in ("rig:x.VAL", "rig:x.TWF", "rig:x:MODE", "rig:x:WAVE:START", "rig:RESET"):
        assert armed.put(name, 1), name
    assert "lease" in armed.value("rig:MESSAGE")
    assert daemon.ask("DELETE", "lease").status_code == 200
    assert armed.put("rig:x.VAL", 5.0) == ""


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
