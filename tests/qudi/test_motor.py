"""The motor interface of qudi moves a simulated stage with the example module."""

import json
import os
import subprocess
from pathlib import Path
from typing import Final

import pytest

from tests.daemon.daemons import REPOSITORY, Daemon, configuration

pytestmark = pytest.mark.qudi
PYTHON: Final = REPOSITORY / "build" / "qudi" / "bin" / "python"
"""Interpreter of the environment that `make qudi` sets up."""
TRIM: Final = "{base: feedforward, gain_per_s: 5, authority_pct: 5}"


def test_qudi_moves_the_simulated_stage(tmp_path: Path) -> None:
    """Its module arms the stage, moves it, refuses what the daemon refuses, holds, and disarms."""
    with Daemon(configuration(tmp_path, trim=TRIM)) as daemon:
        daemon.up()
        environ = {
            **os.environ,
            "HOME": str(tmp_path),  # qudi writes its logs there
            "PYTHONPATH": str(REPOSITORY / "examples" / "qudi"),
            "QT_QPA_PLATFORM": "offscreen",
            "XDG_RUNTIME_DIR": str(daemon.folder),
        }
        done = subprocess.run(
            [PYTHON, Path(__file__).with_name("motor.py")],
            env=environ,
            capture_output=True,
            text=True,
            timeout=200,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        report = json.loads(done.stdout.splitlines()[-1])
        after = daemon.until("SAFE")

    limits = report["constraints"]
    assert (limits["unit"], limits["pos_min"], limits["pos_max"]) == (
        "m",
        0.0,
        pytest.approx(26e-6),
    )
    assert report["absolute"] == [0, pytest.approx(5.0, abs=0.5)]
    assert report["relative"] == [0, pytest.approx(7.5, abs=0.5)]
    assert report["beyond"] == [-1, pytest.approx(7.5, abs=0.5)]
    assert report["stopped"] == [0, {"x": 0}]
    assert report["velocity"] == [{"x": None}, -1, 0]
    assert after["lease"] is None
