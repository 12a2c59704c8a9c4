"""A reload while the stage runs, with real processes."""

import signal
import socket
from pathlib import Path

import pytest

from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import SHIPPED, UP_WITHIN_S, configuration, is_alive, latched
from tests.daemon.waiting import eventually


@pytest.mark.fault("P11")
def test_reload_swaps_as_a_whole_or_keeps(start: StartDaemon, tmp_path: Path) -> None:
    """A valid file is in force after a reload at rest, with the zero; else nothing changes."""
    daemon = start(configuration(tmp_path)).up()
    first = daemon.loop_pid
    daemon.do("zero")
    zero_um = eventually(daemon.zero_um)

    configuration(tmp_path, speed_um_per_s="150", rate_hz="0")
    invalid = daemon.ask("POST", "reload", {})
    configuration(tmp_path, speed_um_per_s="150", rate_hz="25")
    daemon.do("arm")
    daemon.until("READY")
    in_ready = daemon.ask("POST", "reload", {})
    kept = (daemon.loop_pid, daemon.ask("GET", "config").json())
    daemon.do("disarm")
    daemon.until("SAFE")
    swapped = daemon.ask("POST", "reload", {})
    daemon.until("SAFE")

    assert invalid.status_code == 422
    assert "rate_hz: out of range" in invalid.text
    assert in_ready.status_code == 409
    assert (kept[0], kept[1]["rate_hz"]) == (first, 20)
    assert swapped.json() == {"changes": ["axes.x.speed_um_per_s", "rate_hz"], "lost": []}
    assert daemon.zero_um() == zero_um
    assert daemon.ask("GET", "realtime").json()["rate_hz"] == 25
    assert daemon.loop_pid != first
    assert not is_alive(first)
    assert daemon.do("arm")["accepted"]


@pytest.mark.fault("P11")
def test_reload_keeps_what_is_not_in_the_file(start: StartDaemon, tmp_path: Path) -> None:
    """Latched faults and the sensor zero outlive a reload, with and without a change."""
    daemon = start(configuration(tmp_path)).up()
    daemon.do("zero")
    zero_um = eventually(daemon.zero_um)
    daemon.do("estop")
    daemon.until("FAULT")
    first = daemon.loop_pid

    unchanged = daemon.do("reload")
    same = (daemon.loop_pid, daemon.status()["state"], latched(daemon.status()))
    configuration(tmp_path, speed_um_per_s="150")
    changed = daemon.do("reload")
    daemon.until("FAULT")

    assert unchanged["changes"] == []
    assert same == (first, "FAULT", ["E1"])
    assert changed["changes"] == ["axes.x.speed_um_per_s"]
    assert daemon.loop_pid != first
    assert latched(daemon.status()) == ["E1"]
    assert eventually(daemon.zero_um) == zero_um
    eventually(lambda: daemon.ask("POST", "reset", {}).status_code == 200)
    daemon.until("SAFE")


@pytest.mark.fault("P11")
def test_edited_model_file_is_reported_until_it_is_loaded(
    start: StartDaemon, tmp_path: Path
) -> None:
    """A reload takes it over, as it does an edited configuration file."""
    model = tmp_path / "model.yaml"
    model.write_bytes((SHIPPED.parent / "models" / "simulated-stack.yaml").read_bytes())
    daemon = start(configuration(tmp_path, model="model.yaml")).up()
    before = daemon.faults()

    model.write_text(model.read_text("utf-8") + "# edited\n", encoding="utf-8")
    eventually(lambda: "P11" in daemon.faults())
    loaded = daemon.do("reload")
    daemon.until("SAFE")
    eventually(lambda: "P11" not in daemon.faults())

    assert "P11" not in before
    assert loaded["changes"] == ["axes.x.model"]


@pytest.mark.fault("P11")
def test_service_manager_may_reload(start: StartDaemon, tmp_path: Path) -> None:
    """SIGHUP reloads, and the manager gets the beginning and the end."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(UP_WITHIN_S)
        daemon = start(configuration(tmp_path), NOTIFY_SOCKET=str(tmp_path / "notify"))
        _next(manager, b"READY=1")
        configuration(tmp_path, speed_um_per_s="150")

        daemon.signal(signal.SIGHUP)

        _next(manager, b"RELOADING=1")
        _next(manager, b"READY=1")
        assert daemon.ask("GET", "config").json()["axes"]["x"]["speed_um_per_s"] == 150


def _next(manager: socket.socket, beginning: bytes) -> None:
    while not manager.recv(1000).startswith(beginning):
        pass
