"""PyMoDAQ moves a simulated stage with the example plug-in."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any, Final

import pytest

from tests.daemon.daemons import REPOSITORY, Daemon, configuration

pytestmark = pytest.mark.pymodaq
PYTHON: Final = REPOSITORY / "build" / "pymodaq" / "bin" / "python"
"""Interpreter of the environment that `make pymodaq` sets up."""
TRIM: Final = "{base: feedforward, gain_per_s: 5, authority_pct: 5}"


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """Build the wheel of the plug-in; return a folder with its contents."""
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", "."]
    source = REPOSITORY / "examples" / "pymodaq"
    subprocess.run([*command, source], cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as opened:
        opened.extractall(tmp_path / "site")
    return tmp_path / "site"


def run_actuator(daemon: Daemon, installed: Path, home: Path) -> dict[str, Any]:
    """Run PyMoDAQ without a screen; return what it reports."""
    environ = {
        **os.environ,
        "HOME": str(home),  # PyMoDAQ writes settings and logs there
        "PYTHONPATH": str(installed),
        "QT_QPA_PLATFORM": "offscreen",
        "XDG_RUNTIME_DIR": str(daemon.folder),
    }
    done = subprocess.run(
        [PYTHON, Path(__file__).with_name("actuator.py")],
        cwd=home,
        env=environ,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    report: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return report


def test_pymodaq_moves_the_simulated_stage(installed: Path, tmp_path: Path) -> None:
    """It finds the plug-in, takes over the limits, moves in closed loop, stops, and disarms."""
    with Daemon(configuration(tmp_path, trim=TRIM)) as daemon:
        daemon.up()
        report = run_actuator(daemon, installed, tmp_path)
        after = daemon.until("SAFE")

    assert report["connected"] == ["stage rig, axis x: SAFE", True]
    assert report["limits"] == [0.0, 26.0]
    assert "cannot move in SAFE" in report["refused"]
    assert report["reached"] == pytest.approx([5.0, 7.5], abs=0.5)
    assert report["beyond"] == pytest.approx(26.0, abs=0.5)  # PyMoDAQ clamps to the limits
    assert report["after stop"] == pytest.approx(8.0, abs=0.5)
    assert after["lease"] is None
