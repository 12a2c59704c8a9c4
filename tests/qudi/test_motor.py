"""The motor interface of qudi moves a simulated stage with the example module."""

from pathlib import Path
from typing import Final

import pytest

from tests.daemon.daemons import REPOSITORY, Daemon, configuration
from tests.daemon.offscreen import reported

pytestmark = pytest.mark.qudi
TRIM: Final = "{base: feedforward, gain_per_s: 5, authority_pct: 5}"


def test_qudi_moves_the_simulated_stage(tmp_path: Path) -> None:
    """Its module arms the stage, moves it, refuses what the daemon refuses, holds, and disarms."""
    with Daemon(configuration(tmp_path, trim=TRIM)) as daemon:
        daemon.up()
        packages = REPOSITORY / "examples" / "qudi"
        report = reported("qudi", Path(__file__).with_name("motor.py"), daemon, packages)
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
