"""The IOC while things end: daemons that are killed, devices that fail, the IOC itself."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import Figure
from tests.daemon.conftest import StartDaemon, start  # noqa: F401 - a fixture
from tests.daemon.daemons import SHIPPED, Daemon
from tests.daemon.loop.test_pulled_cable import configured
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import emulated
from tests.epics.processes import Ioc, Peer, peer

pytestmark = pytest.mark.epics
INVALID, MAJOR = 3, 2
SHOWN = ("rig:STATE", "rig:FAULTS", "rig:x.RBV", "rig:x:POS", "rig:x:HIST:POS", "rig:LOOP:RATE")


@pytest.fixture
def client(ioc: Ioc) -> Iterator[Peer]:
    """Return a client of the IOC."""
    with peer("aioca", ioc.environ) as client:
        yield client


def give_back_lease(daemon: Daemon) -> None:
    """Release the lease that commands of the test took, so that the IOC can have it."""
    eventually(lambda: daemon.ask("DELETE", "lease").status_code == 200)


def severities(client: Peer) -> list[int]:
    """Return the severities of some records of all kinds."""
    return [client.get(name)["severity"] for name in SHOWN]


def test_records_follow_a_daemon_that_is_killed(
    daemon: Daemon, client: Peer, figure: Figure
) -> None:
    """All records become INVALID, and come back by themselves when the daemon runs again."""
    eventually(lambda: INVALID not in severities(client))
    for name in SHOWN:
        client.watch(name)
    killed_s = time.monotonic()
    daemon.process.kill()
    eventually(lambda: severities(client) == [INVALID] * len(SHOWN))
    gone_s = [
        next(each["s"] for each in client.seen(name) if each["severity"] == INVALID) - killed_s
        for name in SHOWN
    ]
    connected = client.get("rig:CONNECTED")
    daemon.process.wait()
    daemon.start()
    eventually(lambda: INVALID not in severities(client), 90.0)

    figure(f"IOC: records INVALID {max(gone_s):.2f} s after the daemon was killed")
    assert (connected["value"], connected["severity"]) == (0, MAJOR)
    assert client.value("rig:CONNECTED") == 1
    eventually(lambda: daemon.ask("POST", "reset", {}).status_code == 200)
    daemon.until("SAFE")
    give_back_lease(daemon)
    client.until_taken("rig:ARM")
    daemon.until("READY")


def test_stage_goes_on_when_the_ioc_is_killed(daemon: Daemon) -> None:
    """The stage stays in RUN; the lease expires, and another client moves the stage."""
    ioc = Ioc(daemon.folder, "--control", "--prefix", "K:").up()
    try:
        assert ioc.announced == ["K:"]
        with peer("aioca", ioc.environ) as client:
            give_back_lease(daemon)
            daemon.ask("POST", "stop", {})
            daemon.until("SAFE")
            eventually(lambda: client.put("K:ARM", 1) == "" and daemon.status()["state"] == "READY")
            client.put("K:LEASE", 1)
            client.put("K:x:MODE", 3)
            assert client.put("K:x.VAL", 4.0) == ""
        held = daemon.ask("POST", "goto", {"position_um": 3.0}).status_code
        ioc.kill()
    finally:
        ioc.end()
    after = daemon.status()
    eventually(lambda: daemon.ask("POST", "goto", {"position_um": 3.0}).status_code == 200, 45.0)

    assert held == 409
    assert after["state"] == "RUN"
    assert after["axes"]["x"]["target_um"] == 4.0
    daemon.do("stop")


def test_ioc_that_ends_in_order_releases_the_lease(daemon: Daemon) -> None:
    """Another client may move the stage at once."""
    give_back_lease(daemon)
    ioc = Ioc(daemon.folder, "--control").up()
    with peer("aioca", ioc.environ) as client:
        assert client.put("rig:LEASE", 1) == ""
        eventually(lambda: (daemon.status()["lease"] or {}).get("holder", {})["client"] == "ioc")

    assert ioc.end() == 0
    assert daemon.status()["lease"] is None


def test_clients_only_read_without_control(daemon: Daemon) -> None:
    """Every write is refused, over CA and PVA."""
    daemon.ask("POST", "stop", {})
    daemon.until("SAFE")
    ioc = Ioc(daemon.folder).up()
    try:
        for library in ("aioca", "p4p"):
            with peer(library, ioc.environ) as client:
                for name in ("rig:ARM", "rig:ESTOP", "rig:x.VAL", "rig:x:WAVE:LOW", "rig:x.VELO"):
                    assert client.put(name, 1), name
                assert client.value("rig:STATE") == 1
    finally:
        assert ioc.end() == 0

    assert daemon.status()["state"] == "SAFE"


def test_alarms_follow_injected_faults(start: StartDaemon, tmp_path: Path) -> None:  # noqa: F811
    """A cable that is pulled makes BLIND and a bus fault; plugged in and reset, both are gone."""
    with emulated("pi-e816") as far:
        daemon = start(configured(tmp_path, far.where[0])).up()
        ioc = Ioc(daemon.folder, "--control").up()
        try:
            with peer("aioca", ioc.environ) as client:
                # Until the IOC has asked the daemon, its records are INVALID.
                eventually(lambda: client.get("stage:FAULT:BUS")["severity"] == 0)
                before = client.value("stage:FAULT:BUS")
                client.until_taken("stage:RESET")  # a busy machine may have had a fault
                client.until_taken("stage:ARM")
                daemon.until("READY")
                far.faults("disconnect:now:4")
                eventually(lambda: client.get("stage:STATE")["severity"] == MAJOR)
                eventually(lambda: client.get("stage:FAULT:BUS")["severity"] == MAJOR)
                during = client.value("stage:FAULT:BUS"), client.value("stage:FAULT:TEXT")
                axis = client.get("stage:x.RBV")["severity"]
                daemon.until("FAULT")
                eventually(lambda: client.put("stage:RESET", 1) == "" and is_safe(daemon))
                eventually(lambda: client.get("stage:FAULT:BUS")["severity"] == 0)
                eventually(lambda: client.get("stage:STATE")["severity"] == 0)
                eventually(lambda: client.get("stage:x.RBV")["severity"] == 0)
        finally:
            assert ioc.end() == 0

    assert before == ""
    assert "B1" in during[0]
    assert during[1]
    assert axis >= MAJOR


def is_safe(daemon: Daemon) -> bool:
    """Return whether a stage is disarmed."""
    return bool(daemon.status()["state"] == "SAFE")


def test_several_stages_in_one_ioc(
    daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All stages that run are served; `{stage}` in the prefix keeps them apart."""
    folder = str(daemon.folder)
    monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
    second = tmp_path / "second.yaml"
    text = SHIPPED.read_text(encoding="utf-8").replace("models/", f"{SHIPPED.parent}/models/")
    second.write_text(text.replace("rate_hz: 200", "rate_hz: 20"), encoding="utf-8")
    with Daemon(second) as other:
        other.up()
        (daemon.folder / "piezod" / "second").symlink_to(other.paths.api_socket.parent)
        ioc = Ioc(daemon.folder, "--prefix", "BL7:{stage}:").up(2)
        try:
            with peer("p4p", ioc.environ) as client:
                rates = {name: client.value(f"{name}LOOP:RATE") for name in ioc.announced}
        finally:
            assert ioc.end() == 0
            (daemon.folder / "piezod" / "second").unlink()

    assert rates == {"BL7:rig:": 100.0, "BL7:second:": 20.0}
