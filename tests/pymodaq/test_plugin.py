"""PyMoDAQ moves a simulated stage with the example plug-in."""

import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Final

import pytest

from tests.daemon.daemons import REPOSITORY, Daemon, configuration
from tests.daemon.offscreen import reported

pytestmark = pytest.mark.pymodaq
HERE: Final = Path(__file__)
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


def test_pymodaq_moves_the_simulated_stage(installed: Path, tmp_path: Path) -> None:
    """It finds the plug-in, takes over the limits, moves in closed loop, stops, and disarms."""
    with Daemon(configuration(tmp_path, trim=TRIM)) as daemon:
        daemon.up()
        report = reported("pymodaq", HERE.with_name("actuator.py"), daemon, installed)
        after = daemon.until("SAFE")

    assert report["connected"] == ["stage rig, axis x: SAFE", True]
    assert report["limits"] == [0.0, 26.0]
    assert "cannot move in SAFE" in report["refused"]
    assert report["reached"] == pytest.approx([5.0, 7.5], abs=0.5)
    assert report["beyond"] == pytest.approx(26.0, abs=0.5)  # PyMoDAQ clamps to the limits
    assert report["after stop"] == pytest.approx(8.0, abs=0.5)
    assert after["lease"] is None
