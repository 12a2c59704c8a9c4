"""A run of a stage without a sensor, with the commands of the shell."""

from pathlib import Path

from tests.daemon.daemons import REPOSITORY, Daemon

OPEN_LOOP = REPOSITORY / "config" / "open-loop.yaml"


def without_sensor(folder: Path) -> Path:
    """Write the shipped example, at a rate that a busy machine can keep; return its path."""
    text = OPEN_LOOP.read_text(encoding="utf-8")
    text = text.replace("models/", f"{OPEN_LOOP.parent}/models/").replace("200\n", "20\n", 1)
    text = text.replace("{on_arm: true}", "{on_arm: false}").replace("50}", "200}")
    path = folder / "open.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_stage_without_sensor_runs_in_feedforward(tmp_path: Path) -> None:
    """It moves and stops; what needs a sensor is refused with the reason."""
    with Daemon(without_sensor(tmp_path)) as daemon:
        daemon.up()
        at_v = daemon.moving(
            "goto",
            {"position_um": 12.0},
            lambda status: (status["axes"]["x"]["drive_v"] or 0.0) > 50.0,
        )["axes"]["x"]
        waiting = daemon.command("goto", "12.5", "--wait")
        adaptive = daemon.ask("POST", "mode", {"mode": "adaptive"})
        shown = daemon.command("status")
        faults = daemon.status()["faults"]
        daemon.do("stop")
        daemon.until("SAFE")

    assert (at_v["has_sensor"], at_v["position_um"], at_v["mode"]) == (False, None, "feedforward")
    assert waiting.returncode
    assert "axis x has no sensor" in waiting.stderr
    assert adaptive.status_code == 409
    assert "mode adaptive needs a sensor" in adaptive.text
    assert "no sensor" in shown.stdout
    assert [fault["id"] for fault in faults if fault["id"].startswith("S")] == []
