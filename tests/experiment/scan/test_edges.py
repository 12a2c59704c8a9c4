"""Scans in virtual time that a camera steps or starts: no plane is lost, what is odd is told."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from piezod.config.scan import RasterScan, StackScan
from piezod.errors import DataError
from piezod.experiment.scan.run import ScanResult, ScanSetting, Told
from piezod.experiment.virtual.scan import scan_virtually
from piezod.experiment.virtual.stage import VirtualStage
from tests.experiment.scan.test_run import config

PLANES = 50
STACK = {
    "planes": {"axis": "y", "from_um": 8.0, "to_um": 13.0, "pixels": PLANES},
    "plane_s": 0.004,
    "move_s": 0.004,
    "passes": 1,
    "step": "edge",
    "within_s": 0.5,
}


def scanned(
    folder: Path, scan: RasterScan | StackScan, notes: list[str], **camera: Any
) -> ScanResult:
    """Run a scan on a rig with a camera of a hundred pulses a second."""
    given = config(folder)
    rig = given.devices["rig"]
    options = type(rig.options).model_validate({**rig.options.model_dump(), "camera": camera})
    devices = {"rig": rig.model_copy(update={"options": options})}
    given = given.model_copy(update={"devices": devices})
    told = Told(lambda _: None, lambda _: None, lambda *_: None, notes.append)
    return scan_virtually(given, scan, ScanSetting(folder / "scan.nxs", "text"), told)


def edges_of(file: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time in s, plane, and whether it was used, of each edge in a file."""
    with h5py.File(file) as opened:
        edges = opened["scan/edges"]
        return edges["edge_ns"][()] / 1e9, edges["place"][()], edges["used"][()]


def test_each_pulse_ends_a_plane(tmp_path: Path) -> None:
    """Fifty planes, a hundred pulses a second: none lost; each plane has the time of its pulse."""
    notes = list[str]()
    result = scanned(tmp_path, StackScan.model_validate(STACK), notes, pulses=PLANES)
    edge_s, place, used = edges_of(result.file)
    with h5py.File(result.file) as opened:
        first_ns, last_ns = (opened[f"scan/pixels/{x}_ns"][()] for x in ("first", "last"))

    assert notes == []
    assert (place.tolist(), used.tolist()) == (list(range(PLANES)), [1] * PLANES)
    assert edge_s == pytest.approx(0.05 + 0.01 * np.arange(PLANES))
    assert first_ns[1:] / 1e9 == pytest.approx(edge_s[:-1] + 0.004, abs=6e-5)
    assert (last_ns / 1e9 < edge_s).all()
    assert result.frames[-1].true.slow_max < 0.6


def test_odd_pulses_are_told_with_their_plane(tmp_path: Path) -> None:
    """One is missing, one comes too often, and some come after the last plane."""
    notes = list[str]()
    scan = StackScan.model_validate(STACK)
    result = scanned(tmp_path, scan, notes, missing=(13,), extra=(20,), pulses=PLANES + 2)
    _, place, used = edges_of(result.file)
    text = "\n".join(notes)

    assert used.sum() == PLANES
    assert place[used == 0].tolist() == [19, PLANES]
    assert "at 0.2425 s in plane 20" in text
    assert "after the last plane" in text
    assert "1 pulse may be missing" in text
    assert "before the end of plane 13, 0.02 s" in text


def test_a_camera_that_stops_ends_the_scan(tmp_path: Path) -> None:
    """Within the limit, with the plane; the file has the planes before it."""
    notes = list[str]()
    with pytest.raises(DataError, match=r"within 0\.5 s .* in plane 21 of 50"):
        scanned(tmp_path, StackScan.model_validate(STACK), notes, pulses=20)
    _, _, used = edges_of(tmp_path / "scan.nxs")
    with h5py.File(tmp_path / "scan.nxs") as opened:
        rows = opened["scan/pixels/row"][()]
        picture = opened["scan/picture/photons"][()]

    assert rows.tolist() == list(range(20))
    assert used.tolist() == [1] * 20
    assert np.isfinite(picture).tolist() == [True] * 20 + [False] * 30
    assert any("20 of 50 sweeps are stored" in note for note in notes)


def test_a_device_that_does_not_wait_refuses_before_anything_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With what it is about, and which devices do."""
    monkeypatch.setattr("piezod_drivers.simulated.player.EDGE_WAITS", 0)
    monkeypatch.setattr(VirtualStage, "run", lambda *_: pytest.fail("it has moved"))
    with pytest.raises(DataError, match=r"step: the device does not wait .* player board"):
        scanned(tmp_path, StackScan.model_validate(STACK), [])


def test_an_edge_starts_a_frame(tmp_path: Path) -> None:
    """The stored one, once; without an edge nothing is stored."""
    given = config(tmp_path).scan
    assert isinstance(given, RasterScan)
    scan = given.model_copy(update={"start": "edge", "within_s": 0.2, "passes": 1})
    notes = list[str]()
    result = scanned(tmp_path, scan, notes, pulses=1)
    edge_s, _, used = edges_of(result.file)
    with h5py.File(result.file) as opened:
        assert opened["scan/pixels/first_ns"][0] == 0
        assert opened["scan/pixels/row"].size == 24 * 12
    result.file.unlink()

    # It has waited where the fast axis turns: the first sweep is as true as the others.
    assert result.frames[-1].true.fast_max < 0.3
    assert (edge_s.tolist(), used.tolist()) == ([0.05], [1])
    with pytest.raises(DataError, match="before its first sweep"):
        scanned(tmp_path, scan, notes, first_s=1.0)
    assert not any("moved nothing" in note for note in notes)
