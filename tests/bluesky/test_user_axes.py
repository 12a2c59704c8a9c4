"""User axes as motors of Bluesky: a table of three actuators, with two angles."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import bluesky.plan_stubs as bps
import pytest
from bluesky.plans import scan
from bluesky.run_engine import RunEngine
from bluesky.utils import FailedStatus
from ophyd_async.core import StaticPathProvider, UUIDFilenameProvider, init_devices

from piezod.bluesky import PiezoStage, Scan
from tests.bluesky.fixtures import make_run
from tests.bluesky.rigs import Documents
from tests.bluesky.test_fly import column, fly
from tests.daemon.daemons import REPOSITORY, Daemon

pytestmark = pytest.mark.bluesky

SLOWLY = {"lines_per_s": 2.0, "mode": "trimmed"}


@pytest.fixture
def table(engine: RunEngine, tmp_path: Path) -> Iterator[PiezoStage]:
    """Return the shipped table as a device."""
    with Daemon(REPOSITORY / "config" / "tip-tilt.yaml") as daemon:
        make_run(daemon.up())
        with init_devices():
            stage = PiezoStage(
                axes=("z", "rx"),
                socket=daemon.paths.api_socket,
                path_provider=StaticPathProvider(UUIDFilenameProvider(), tmp_path),
                name="table",
            )
        yield stage
        asyncio.run_coroutine_threadsafe(stage.disconnect(), engine.loop).result(20.0)


def test_an_angle_is_scanned_in_its_unit(
    engine: RunEngine, documents: Documents, table: PiezoStage
) -> None:
    """Readings, speed and limits of an angle are in urad; a target beyond them is told in µrad."""
    engine(bps.mv(table.z, 12.0))
    engine(scan([], table.rx, -50.0, 50.0, 3))
    (descriptor,) = documents.of("descriptor")
    assert descriptor["data_keys"]["table-rx"]["units"] == "urad"
    keys = descriptor["configuration"]["table-rx"]["data_keys"]
    assert keys["table-rx-speed"]["units"] == "urad/s"
    assert keys["table-rx-low_limit"]["units"] == "urad"
    values = descriptor["configuration"]["table-rx"]["data"]
    assert values["table-rx-speed"] == 2000.0
    assert (values["table-rx-low_limit"], values["table-rx-high_limit"]) == (-110.0, 110.0)
    angles = [event["data"]["table-rx"] for event in documents.of("event")]
    assert angles == pytest.approx([-50.0, 0.0, 50.0], abs=6.0)
    with pytest.raises(FailedStatus, match="-110 to 110 µrad"):
        engine(bps.mv(table.rx, 200.0))


def test_a_fly_scan_has_the_unit_of_each_axis(
    engine: RunEngine, documents: Documents, table: PiezoStage
) -> None:
    """Columns of the angle, and of its error, are in urad; those of the height in um."""
    fast = {"axis": "rx", "from_um": -20.0, "to_um": 20.0, "pixels": 4}
    slow = {"axis": "z", "from_um": 10.0, "to_um": 12.0, "pixels": 2}
    engine(fly(table, Scan({"kind": "raster", "fast": fast, "slow": slow, **SLOWLY})))
    (descriptor,) = documents.of("descriptor")
    units = {name: key.get("units") for name, key in descriptor["data_keys"].items()}
    assert units["table-rx"] == units["table-error"] == "urad"
    assert units["table-z"] == "um"
    assert len(column(documents, "table-rx")) == 8
