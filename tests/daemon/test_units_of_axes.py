"""The unit of a user axis in everything that shows it: a table with an angle in µrad."""

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest

from piezod.client import StageClient
from piezod.client.facts import facts_in
from piezod.config.scan import AnyScan, scan_from
from piezod.errors import DataError
from piezod.experiment.live.scan import scan_live
from piezod.experiment.scan.run import ScanSetting, Told
from piezod.gcs.queries import AXIS_QUERIES
from piezod.gcs.readings import AxisNow
from piezod.ioc.server import names_of
from piezod.records.figures.scan import scan_figure
from piezod.records.recording.export import export_table
from piezod.records.scan_file import read_scan
from tests.daemon.daemons import REPOSITORY, Daemon

UNITS = {"z": "um", "rx": "urad", "a": "um"}
SILENT = Told(lambda _: None, lambda _: None, lambda *_: None, lambda _: None)


@pytest.fixture(scope="module")
def daemon() -> Iterator[Daemon]:
    """Return the daemon of the shipped table."""
    with Daemon(REPOSITORY / "config" / "tip-tilt.yaml") as daemon:
        yield daemon.up()


@pytest.fixture
def client(daemon: Daemon) -> Iterator[StageClient]:
    """Return a connection to it."""
    with StageClient(socket=daemon.paths.api_socket) as client:
        yield client


def raster(**more: object) -> AnyScan:
    """Return a slow raster of the angle, over the height."""
    fast = {"axis": "rx", "from_um": -20.0, "to_um": 20.0, "pixels": 4}
    slow = {"axis": "z", "from_um": 10.0, "to_um": 12.0, "pixels": 2}
    return scan_from({"kind": "raster", "fast": fast, "slow": slow, "lines_per_s": 2.0, **more})


def test_clients_get_the_unit(client: StageClient) -> None:
    """GCS, EPICS and Prometheus say µm or µrad, as the axis is."""
    axes, facts = client.status().axes, facts_in(client.config())
    unit, _ = AXIS_QUERIES["PUN?"]
    now = {name: AxisNow(name, "SAFE", axes[name], facts[name], "trimmed") for name in UNITS}
    assert {name: unit(each) for name, each in now.items()} == UNITS
    units = {name: record.unit for name, record in names_of("p:", "table", axes).all()}
    of_angle = {units[name] for name in units if name.startswith("p:rx:")}
    assert "urad" in of_angle
    assert not any(unit.startswith("um") for unit in of_angle)
    metrics = client.metrics()
    for name, unit_of in UNITS.items():
        is_angle = unit_of == "urad"
        assert (f'axis_position_radians{{axis="{name}"' in metrics) == is_angle
        assert (f'axis_error_meters_count{{axis="{name}"' in metrics) != is_angle


def test_a_user_axis_is_scanned_in_its_unit(
    client: StageClient, daemon: Daemon, tmp_path: Path
) -> None:
    """The loop sweeps the angle; scan file, figure, recording and export have its unit."""
    file = tmp_path / "scan.nxs"
    scan_live(client, raster(mode="trimmed"), ScanSetting(file, ""), SILENT)
    with h5py.File(file) as opened:
        entry = opened["scan"]
        for name, column in (("rx", "rx_um"), ("z", "z_um"), ("rx", "error_um")):
            assert entry["picture"][column].attrs["units"] == UNITS[name]
            listed = column if column == "error_um" else f"position_{column}"
            assert entry["pixels"][listed].attrs["units"] == UNITS[name]
        swept = entry["pixels/position_rx_um"][()].reshape(2, 4)
    assert np.abs(swept) == pytest.approx(np.array([[15, 5, 5, 15]] * 2), abs=3.0)
    axes = scan_figure(read_scan(file)).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("rx (µrad)", "z (µm)")

    (recording,) = daemon.paths.state.glob("recordings/*.h5")
    with h5py.File(recording) as opened:
        entry = opened["recording"]
        for name, unit in UNITS.items():
            assert entry[f"axis_{name}"]["position_um"].attrs["units"] == unit
    exported = tmp_path / "table.parquet"
    export_table(exported, recording, UNITS)
    schema = pq.read_schema(exported)
    for name, unit in UNITS.items():
        assert schema.field(f"{name}_position_um").metadata[b"units"] == unit.encode()


@pytest.mark.parametrize(
    ("scan", "what"),
    [
        (raster(), "the loop moves user axes"),
        (raster(fast={"axis": "a", "from_um": 1, "to_um": 2, "pixels": 2}), "no such axis"),
        (raster(fast={"axis": "rx", "from_um": 1, "to_um": 200, "pixels": 2}), "-110 to 110"),
    ],
)
def test_what_does_not_fit_is_refused(
    client: StageClient, tmp_path: Path, scan: AnyScan, what: str
) -> None:
    """A table of a device, an actuator of user axes, and a place outside their range."""
    with pytest.raises(DataError, match=what):
        scan_live(client, scan, ScanSetting(tmp_path / "scan.nxs", ""), SILENT)
