"""pymmcore-plus acquires a z-stack with the example device."""

from pathlib import Path
from typing import Final

import pytest

from tests.daemon.daemons import REPOSITORY, Daemon, configuration
from tests.daemon.offscreen import reported

pytestmark = pytest.mark.pymmcore
TRIM: Final = "{base: feedforward, gain_per_s: 5, authority_pct: 5}"


def test_each_plane_is_exposed_on_target(tmp_path: Path) -> None:
    """Its engine moves the stage from plane to plane; the stage is armed while it is loaded."""
    with Daemon(configuration(tmp_path, trim=TRIM)) as daemon:
        daemon.up()
        packages = REPOSITORY / "examples" / "pymmcore"
        report = reported("pymmcore", Path(__file__).with_name("stack.py"), daemon, packages)
        after = daemon.until("SAFE")

    assert [wanted_um for wanted_um, _ in report["planes"]] == [4.0, 6.0, 8.0, 10.0, 12.0]
    for wanted_um, seen_um in report["planes"]:
        assert seen_um == pytest.approx(wanted_um, abs=0.5)
    assert "out of range" in report["refused"]
    assert report["after"] == pytest.approx(12.0, abs=0.5)
    assert after["lease"] is None
