"""A configuration that is read again while the stage runs, as processes."""

import signal
from pathlib import Path

import pytest

from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import UP_WITHIN_S, configuration, is_alive
from tests.daemon.waiting import eventually


@pytest.mark.fault("P11")
def test_reload_swaps_as_a_whole_or_keeps(start: StartDaemon, tmp_path: Path) -> None:
    """A valid file is in force after a reload, and nothing else ever is."""
    daemon = start(configuration(tmp_path)).up()
    first = daemon.loop_pid

    configuration(tmp_path, speed_um_per_s="150", rate_hz="0")
    invalid = daemon.ask("POST", "reload", {})
    configuration(tmp_path, speed_um_per_s="150", rate_hz="80")
    daemon.do("arm")
    in_ready = daemon.ask("POST", "reload", {})
    kept = (daemon.loop_pid, daemon.ask("GET", "config").json())
    daemon.do("disarm")
    daemon.until("SAFE")
    swapped = daemon.ask("POST", "reload", {})
    daemon.until("SAFE")

    assert invalid.status_code == 422
    assert "rate_hz: out of range" in invalid.text
    assert in_ready.status_code == 409
    assert (kept[0], kept[1]["rate_hz"]) == (first, 100)
    assert swapped.json()["changes"] == ["axes.x.speed_um_per_s", "rate_hz"]
    assert daemon.ask("GET", "realtime").json()["rate_hz"] == 80
    assert daemon.loop_pid != first
    assert not is_alive(first)
    assert daemon.do("arm")["accepted"]


@pytest.mark.fault("P11")
def test_configuration_that_does_not_come_up_is_taken_back(
    start: StartDaemon, tmp_path: Path
) -> None:
    """A loop that cannot use a valid file is replaced by one with the old configuration."""
    daemon = start(configuration(tmp_path)).up()
    daemon.signal(signal.SIGHUP)
    eventually(lambda: "reload" in daemon.text and daemon.status().get("state") == "SAFE")
    before = daemon.ask("GET", "config").json()

    configuration(tmp_path, sensor="nothing", rig="{driver: simulated, options: {variant: stack}}")
    refused = daemon.ask("POST", "reload", {})

    assert refused.status_code in (409, 422)
    daemon.until("SAFE", UP_WITHIN_S)
    assert daemon.ask("GET", "config").json() == before
