"""A client of the IOC lets the device of a simulated stage play a table of voltages."""

from collections.abc import Iterator
from math import pi, sin
from typing import Any, Final

import pytest

from tests.daemon.daemons import Daemon
from tests.daemon.waiting import eventually
from tests.epics.processes import Ioc, Peer, peer

pytestmark = pytest.mark.epics
READY, IDENT = 2, 4
"""Values of `STATE`."""
MAJOR: Final = 2
INTERVAL_S: Final = 1e-4
POINTS: Final = 200
CYCLES: Final = 10
TABLE_V: Final = [30.0 - 20.0 * sin(2.0 * pi * i / POINTS) for i in range(POINTS)]


@pytest.fixture(params=["aioca", "p4p"])
def client(request: pytest.FixtureRequest, ioc: Ioc) -> Iterator[Peer]:
    """Return a client over CA, and one over PVA."""
    with peer(request.param, ioc.environ) as client:
        yield client


@pytest.fixture
def ready(client: Peer, daemon: Daemon) -> Peer:
    """Return a client of the stage, which is armed and at rest, with the settings of a play."""
    if daemon.status()["state"] != "READY":
        client.until_taken("rig:STOP")
        daemon.until("SAFE")
        client.until_taken("rig:ARM")
        daemon.until("READY")
    for name, value in (("INTERVAL", INTERVAL_S), ("CYCLES", CYCLES), ("TABLE", TABLE_V)):
        assert client.put(f"rig:x:PLAY:{name}", value) == ""
    return client


def test_client_plays_a_table(ready: Peer, daemon: Daemon) -> None:
    """The device plays the voltages by its clock; the records then have what the daemon has."""
    before = last_play(daemon).get("number")
    ready.watch("rig:STATE")
    assert ready.put("rig:x:PLAY:START", 1) == ""
    eventually(lambda: last_play(daemon).get("number") != before)
    daemon.until("READY")
    assert ready.put("rig:x:PLAY:READ", 1) == ""
    drive_v, position_um = ready.value("rig:x:PLAY:DRIVE"), ready.value("rig:x:PLAY:POS")

    played = last_play(daemon)
    assert [each["value"] for each in ready.seen("rig:STATE")][:2] == [READY, IDENT]
    assert [ready.get(f"rig:x:PLAY:{name}")["severity"] for name in ("DRIVE", "POS")] == [0, 0]
    assert drive_v == pytest.approx(TABLE_V, abs=0.01)
    assert (drive_v, position_um) == (played["drive_v"], played["position_um"])
    assert len(position_um) == CYCLES * POINTS
    assert ready.value("rig:x:PLAY:POS:INTERVAL") == played["record_interval_s"] == INTERVAL_S
    assert 4.0 < max(position_um[-POINTS:]) - min(position_um[-POINTS:]) < 9.0


def test_play_that_is_not_possible_is_refused(ready: Peer, daemon: Daemon) -> None:
    """A voltage beyond the limits and a stage that is not armed make the write fail."""
    assert ready.put("rig:x:PLAY:TABLE", [*TABLE_V[:-1], 151.0]) == ""
    assert ready.put("rig:x:PLAY:START", 1)
    beyond = ready.value("rig:MESSAGE"), ready.get("rig:x:PLAY:START")["severity"]
    assert ready.put("rig:x:PLAY:TABLE", TABLE_V) == ""
    assert ready.put("rig:STOP", 1) == ""
    daemon.until("SAFE")
    assert ready.put("rig:x:PLAY:START", 1)

    assert "point 199 of the period is 151 V, allowed range 0 to 150 V" in beyond[0]
    assert beyond[1] == MAJOR
    eventually(lambda: "in SAFE: `piezod arm` first" in ready.value("rig:MESSAGE"))


def last_play(daemon: Daemon) -> dict[str, Any]:
    """Return the record of the last play; empty if there is none."""
    answer = daemon.ask("GET", "play")
    record: dict[str, Any] = answer.json() if answer.status_code == 200 else {}
    return record
