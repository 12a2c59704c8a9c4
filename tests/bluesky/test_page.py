"""The example of docs/bluesky.md, and what needs no movement."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from bluesky import plan_stubs as bps
from bluesky import plans as bp
from bluesky.run_engine import RunEngine, RunEngineResult
from bluesky.simulators import check_limits
from bluesky.utils import FailedStatus, MsgGenerator
from ophyd_async.core import NotConnectedError, init_devices

from piezod.bluesky import PiezoStage
from piezod.errors import RefusedError
from tests.bluesky.fixtures import make_run
from tests.bluesky.rigs import CLOSE_UM, Bench, Documents
from tests.docs.blocks import ROOT, blocks

pytestmark = pytest.mark.bluesky
WITHIN_S = 120.0


def test_the_example_of_the_page_runs(coarse: Bench, tmp_path: Path) -> None:
    """It arms the stage, scans, and flies."""
    page = blocks(ROOT / "docs" / "bluesky.md")
    example = next(block for block in page if block.language == "python")
    make_run(coarse.daemon)
    done = subprocess.run(
        [sys.executable, "-c", example.text],
        cwd=tmp_path,
        env={**os.environ, "XDG_RUNTIME_DIR": str(coarse.daemon.folder)},
        capture_output=True,
        text=True,
        timeout=WITHIN_S,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    assert done.stdout.count("event {'stage-x': ") == 10
    assert done.stdout.count("stream_datum {") == 4
    assert len(list(tmp_path.glob("*.h5"))) == 1


def test_limits_are_checked_before_a_plan_runs(
    engine: RunEngine, x: PiezoStage, coarse: Bench
) -> None:
    """A target out of range is refused, by the simulator and in the plan; nothing moves."""
    motion = coarse.daemon.status()["axes"]["x"]["motion"]
    with pytest.raises(RefusedError, match=r"got 30 µm.*allowed: 0 to 26 µm"):
        check_limits(bp.scan([], x.x, 4.0, 30.0, 2))
    with pytest.raises(FailedStatus) as caught:
        engine(bps.mv(x.x, 30.0))

    assert isinstance(caught.value.__cause__, RefusedError)
    assert coarse.daemon.status()["axes"]["x"]["motion"] == motion


def test_devices_can_be_monitored_and_read(
    engine: RunEngine, documents: Documents, x: PiezoStage
) -> None:
    """The state is a signal, and the position has new values while it is monitored."""

    def plan() -> MsgGenerator[str]:
        yield from bps.open_run()
        yield from bps.monitor(x.x.position, name="position")
        yield from bps.mv(x.x, 3.0)
        yield from bps.mv(x.x, 9.0)
        yield from bps.unmonitor(x.x.position)
        yield from bps.close_run()
        return (yield from bps.rd(x.state))

    result = engine(plan())

    assert isinstance(result, RunEngineResult)
    assert result.plan_result == "RUN"
    positions_um = [event["data"]["coarse-x"] for event in documents.of("event")]
    assert len(positions_um) > 3
    assert positions_um[-1] == pytest.approx(9.0, abs=CLOSE_UM)


@pytest.mark.usefixtures("engine")
def test_no_daemon_and_no_axis(coarse: Bench, tmp_path: Path) -> None:
    """Devices that cannot connect say why."""
    with pytest.raises(NotConnectedError, match="no daemon is running"), init_devices():
        absent = PiezoStage(axes=("x",), socket=tmp_path / "api.sock")
    with (
        pytest.raises(NotConnectedError, match="coarse has no axis z; its axes are x"),
        init_devices(),
    ):
        other = PiezoStage(axes=("z",), socket=coarse.daemon.paths.api_socket)
    assert (absent.name, other.name) == ("absent", "other")


def test_plans_run_without_any_stage(engine: RunEngine, documents: Documents) -> None:
    """In mock mode an axis arrives at once."""
    with init_devices(mock=True):
        stage = PiezoStage(axes=("x", "y"))

    engine(bp.grid_scan([], stage.x, 1.0, 2.0, 2, stage.y, 3.0, 4.0, 2))

    events = [event["data"] for event in documents.of("event")]
    assert [(data["stage-x"], data["stage-y"]) for data in events] == [
        (1.0, 3.0),
        (1.0, 4.0),
        (2.0, 3.0),
        (2.0, 4.0),
    ]
