"""A table that a simulated device plays, as a fly scan."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bluesky.run_engine import RunEngine
from bluesky.utils import FailedStatus
from ophyd_async.core import StaticPathProvider, UUIDFilenameProvider, init_devices

from piezod.bluesky import PiezoStage, Play
from tests.bluesky.rigs import Documents
from tests.bluesky.test_fly import column, fly
from tests.daemon.daemons import Daemon, configuration

pytestmark = pytest.mark.bluesky

SWING_V = 40.0 - 20.0 * np.cos(2 * np.pi * np.arange(100) / 100)


@pytest.fixture
def stage(engine: RunEngine, tmp_path: Path) -> Iterator[PiezoStage]:
    """Return a simulated stage that a plan arms."""
    with Daemon(configuration(tmp_path)) as daemon:
        daemon.up()
        with init_devices():
            stage = PiezoStage(
                axes=("x",),
                socket=daemon.paths.api_socket,
                path_provider=StaticPathProvider(UUIDFilenameProvider(), tmp_path),
                arm=True,
            )
        yield stage
        asyncio.run_coroutine_threadsafe(stage.disconnect(), engine.loop).result(20.0)


def test_a_play_has_its_record(engine: RunEngine, documents: Documents, stage: PiezoStage) -> None:
    """The rows are the record of the device, with the voltages of the table beside it."""
    table = Play("x", SWING_V.tolist(), interval_s=0.001, cycles=3)

    engine(fly(stage, table))

    position_um, drive_v, t_s = (
        column(documents, f"stage-{name}") for name in ("x", "x-drive", "t")
    )
    played = asyncio.run_coroutine_threadsafe(stage.link.daemon.played(), engine.loop).result(20.0)
    assert position_um == pytest.approx(np.array(played["position_um"], float), nan_ok=True)
    assert np.diff(t_s) == pytest.approx(played["record_interval_s"])
    table_v = np.tile(SWING_V, 3)[np.rint(t_s / 0.001).astype(int)]
    assert drive_v == pytest.approx(table_v, abs=0.01)  # the resolution of the device
    assert np.corrcoef(position_um, drive_v)[0, 1] > 0.95
    (resource, *_) = documents.of("stream_resource")
    assert resource["parameters"]["dataset"] == "play/position_um"


def test_a_play_beyond_the_range_is_refused(engine: RunEngine, stage: PiezoStage) -> None:
    """Nothing is played."""
    with pytest.raises(FailedStatus) as caught:
        engine(fly(stage, Play("x", [0.0, 200.0], interval_s=0.001, cycles=1)))

    assert "axis x: 0 to 200 V; allowed: 0 to 150 V" in str(caught.value.__cause__)
