"""An amplifier that is slower than the loop: a daemon with emulated devices."""

from pathlib import Path
from typing import Any

from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import EXAMPLE, device_configuration, latched
from tests.drivers.bus.bench import emulated


def on_target(status: dict[str, Any]) -> bool:
    """Return whether the stage is on target."""
    return bool(status["axes"]["x"]["on_target"])


def test_a_loop_is_faster_than_its_amplifier(start: StartDaemon, tmp_path: Path) -> None:
    """The amplifier is used behind a worker, reaches the target and causes no fault."""
    with emulated("mdt693b", "ild1420") as far:
        amplifier, laser = far.where
        changes = {
            f"{EXAMPLE}-MDT": amplifier,
            f"{EXAMPLE}-ILD": laser,
            "rate_hz: 25": "rate_hz: 60",
        }
        slow = {"timeout_ms: 100": "timeout_ms: 2000"}
        daemon = start(device_configuration(tmp_path, "mdt693b", changes | slow)).up()
        places = {each["name"]: each["placement"] for each in daemon.status()["devices"]}
        status = daemon.moving("goto", {"position_um": 5.0}, on_target)
        daemon.process.terminate()
        code = daemon.exit_code()

    assert places["amplifier"] == "behind a worker"
    assert latched(status) == []
    assert code == 0
