"""Nothing is imported once a stage runs: an upgrade may have taken the module away."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from piezod.messages.endpoints import ENDPOINTS
from tests.daemon.daemons import StartedDaemon, configuration
from tests.hosted_rig import hosted

SITE = """\
import os, sys
closed, imported = {closed!r}, {imported!r}

class Closed:
    def find_spec(self, name, path=None, target=None):
        if os.path.exists(closed):
            with open(imported, "a") as file:
                file.write(name + "\\n")
            raise ModuleNotFoundError(name, name=name)

if not os.path.exists(closed):
    sys.meta_path.insert(0, Closed())
"""
"""Python runs it before all else, in each process of the daemon; those of a reload are new."""
WAVE = {"kind": "sine", "low": 5.0, "high": 8.0, "frequency_hz": 0.5}
BODIES: dict[str, dict[str, Any]] = {
    "mode": {"mode": "feedforward"},
    "goto": {"position_um": 6.0},
    "wave": {"command_um": {"x": WAVE}, "duration_s": 1.0},
    "identify": {"drive_v": {"x": WAVE}, "duration_s": 1.0},
    "recordings/start": {"label": "late"},
}
LEFT_OUT = {"shutdown", "session", "stream"}


def ask_all(daemon: StartedDaemon) -> None:
    """Send every request but those that end the stage or never end; refusals do no harm."""
    for row in ENDPOINTS.values():
        path = row.path.split("/{")[0]
        if path in LEFT_OUT or path.startswith("telemetry"):
            continue
        daemon.ask(row.method, path, BODIES.get(path, {}) if row.method == "POST" else None)


@pytest.mark.fault("P3")
def test_running_stage_imports_nothing(tmp_path: Path) -> None:
    """Neither does a request, nor telemetry, nor the rescue when the loop has died."""
    closed, imported = tmp_path / "closed", tmp_path / "imported"
    text = SITE.format(closed=str(closed), imported=str(imported))
    (tmp_path / "sitecustomize.py").write_text(text, encoding="ascii")
    rig = f"{{driver: emulated, options: {{socket: {tmp_path}/rig.sock, deadline_ms: 500}}}}"
    with (
        hosted(tmp_path / "rig.sock", tmp_path / "trace.csv"),
        StartedDaemon(configuration(tmp_path, rig=rig), PYTHONPATH=str(tmp_path)) as daemon,
    ):
        daemon.up().do("arm")  # the rescuer is ready
        closed.touch()
        ask_all(daemon)
        os.kill(daemon.loop_pid, signal.SIGKILL)
        code, log = daemon.exit_code(), daemon.text

    names = imported.read_text(encoding="ascii").split() if imported.exists() else []
    assert names == []
    assert code == 1, log
