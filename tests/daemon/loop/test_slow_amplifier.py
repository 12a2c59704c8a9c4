"""An amplifier that is slower than the loop: a daemon with emulated devices."""

from pathlib import Path
from typing import Any

from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import REPOSITORY, latched
from tests.drivers.bus.bench import emulated

SLOW = {"mdt": "/dev/serial/by-id/EXAMPLE-MDT", "ild": "/dev/serial/by-id/EXAMPLE-ILD"}


def configured(folder: Path, amplifier: str, sensor: str, rate_hz: float) -> Path:
    """Write the configuration of an amplifier of some tens of hertz, and a laser sensor."""
    text = (REPOSITORY / "config" / "devices" / "mdt693b.yaml").read_text(encoding="utf-8")
    text = text.replace(SLOW["mdt"], amplifier).replace(SLOW["ild"], sensor)
    text = text.replace("../models/", f"{REPOSITORY}/config/models/")
    text = text.replace("timeout_ms: 100", "timeout_ms: 2000")
    text = text.replace("rate_hz: 25", f"rate_hz: {rate_hz:g}")
    path = folder / "stage.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def on_target(status: dict[str, Any]) -> bool:
    """Return whether the stage is on target."""
    return bool(status["axes"]["x"]["on_target"])


def test_a_loop_is_faster_than_its_amplifier(start: StartDaemon, tmp_path: Path) -> None:
    """The amplifier is used behind a worker, reaches the target and causes no fault."""
    with emulated("mdt693b", "ild1420") as far:
        amplifier, laser = far.where
        daemon = start(configured(tmp_path, amplifier, laser, 60.0)).up()
        places = {each["name"]: each["placement"] for each in daemon.status()["devices"]}
        status = daemon.moving("goto", {"position_um": 5.0}, on_target)
        daemon.process.terminate()
        code = daemon.exit_code()

    assert places["amplifier"] == "behind a worker"
    assert latched(status) == []
    assert code == 0
