"""A scan in its thread: block after block, stored as it comes; stopped where the axes are."""

from pathlib import Path

import numpy as np
import pytest

from piezod.config.daemon import DaemonConfig
from piezod.control.stage.playing import PlayOutcome
from piezod.daemon.clock import MonotonicClock
from piezod.daemon.loop.play_thread import PlayThreads, play_threads
from piezod.daemon.paths import SCANNED, SCANNED_ROWS
from piezod.daemon.stage.errors import UnknownNameError
from piezod.daemon.stage.scanned import scanned_part
from piezod.devices.channels import Channels
from piezod.devices.player import EdgeWaits
from piezod.devices.scan_table import ScanTable
from piezod.devices.wiring import construct, pairs_of
from piezod_drivers.simulated.camera import CameraOptions
from piezod_drivers.simulated.options import SimulatedOptions
from tests.daemon.waiting import eventually

AXIS = {
    "amplifier": {"device": "rig"},
    "sensor": {"device": "rig", "beside": ("photons",)},
    "limits": {"drive_min_v": 0.0, "drive_max_v": 150.0, "slew_v_per_s": 2000.0, "rest_v": 0.0},
    "command_range_um": (0.0, 26.0),
}
POINTS, SWEEPS = 100, 6


class Scanning:
    """A simulated rig with two axes, and what plays on it."""

    def __init__(self, folder: Path, camera: CameraOptions | None = None) -> None:
        options = SimulatedOptions(sub_step_us=50, camera=camera)
        rig = {"rig": {"driver": "simulated", "options": options}}
        config = DaemonConfig.model_validate(
            {"rate_hz": 100.0, "devices": rig, "axes": {"x": AXIS, "y": AXIS}}
        )
        pairs = pairs_of(config.axes)
        devices, self.clock = construct(config.devices, pairs, 1), MonotonicClock()
        self.channels = Channels(devices, pairs)
        self.channels.open()
        self.channels.activate(self.clock.now_ns())
        self.folder = folder
        file = folder / "play.json"
        self.threads: PlayThreads = play_threads(config, self.channels, (), self.clock, file)

    def outcome(self) -> PlayOutcome:
        """Wait for the end."""
        found = eventually(self.threads.outcome)
        assert found is not None
        return found

    def part(self, first: int = 0) -> dict[str, object]:
        """Return what the supervisor tells of the scan."""
        return scanned_part(self.folder / SCANNED, self.folder / SCANNED_ROWS, first)


def table(top_v: float = 20.0, sweeps: int = SWEEPS) -> ScanTable:
    """Return a scan of both axes, of 0.1 s a sweep."""
    way = top_v * (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(POINTS) / POINTS))
    levels = np.linspace(0.0, 5.0, sweeps)
    return ScanTable(
        axes=("x", "y"),
        interval_ns=1_000_000,
        lead_in_v=np.zeros((10, 2)),
        line_v=np.stack((way, np.zeros(POINTS)), axis=1),
        offset_v=np.stack((np.zeros(sweeps), levels), axis=1),
        scale=np.ones((sweeps, 2)),
        blend=np.tile(np.linspace(0.0, 1.0, POINTS)[:, None], (1, 2)),
        pulses=np.empty(0, np.uint8),
        pause=POINTS,
    )


def stepped() -> ScanTable:
    """Return a scan of which an edge ends each sweep; it waits half a second for each."""
    held = POINTS // 2
    blend = np.clip((np.arange(POINTS) - held + 1) / (POINTS - held), 0.0, 1.0)
    return table(top_v=0.0)._replace(
        blend=np.tile(blend[:, None], (1, 2)),
        edges=EdgeWaits(held, POINTS, SWEEPS, 500_000_000),
        tail=POINTS,
    )


def test_samples_are_stored_block_by_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both axes and the input beside; the outcome has the last voltage of both."""
    monkeypatch.setattr("piezod.devices.played_scan.MOST_BLOCK_POINTS", 2 * POINTS)
    scanning = Scanning(tmp_path)
    assert scanning.threads.scan_refusal((0, 1), table()) == ""
    scanning.threads.begin_scan((0, 1), table())
    outcome = scanning.outcome()
    first, later = scanning.part(), scanning.part(SWEEPS - 1)
    samples = first["samples"]

    assert outcome.failed == ""
    assert outcome.drives_v == pytest.approx((0.0, 5.0), abs=0.1)
    assert (first["done"], first["ended"], first["failed"]) == (SWEEPS, True, "")
    assert isinstance(samples, dict)
    assert list(samples) == ["x", "y", "photons"]
    assert {len(values) for values in samples.values()} == {SWEEPS * POINTS}
    assert np.ptp(samples["x"]) > 2.0
    assert len(later["samples"]["x"]) == POINTS  # type: ignore[index] # a mapping, as above
    scanning.channels.close()


def test_a_stop_leaves_the_voltages_in_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are those at which the device has stopped; the sweeps before the stop stay."""
    monkeypatch.setattr("piezod.devices.played_scan.MOST_BLOCK_POINTS", POINTS)
    scanning = Scanning(tmp_path)
    scanning.threads.begin_scan((0, 1), table(sweeps=600))
    eventually(lambda: (tmp_path / SCANNED).exists() and scanning.part()["done"])
    scanning.threads.abort()
    outcome = scanning.outcome()
    read_v = scanning.channels.read_back(scanning.clock.now_ns())
    part = scanning.part()

    assert outcome.drives_v == pytest.approx(read_v, abs=0.5)
    assert (part["failed"], part["ended"]) == ("it was aborted", True)
    assert part["samples"]
    scanning.channels.close()


def test_each_edge_ends_a_sweep(tmp_path: Path) -> None:
    """The lead-in is played before; all edges are in the record, and none is missing."""
    scanning = Scanning(tmp_path, CameraOptions(rate_hz=8.0, extra=(2,)))
    scanning.threads.begin_scan((0, 1), stepped())
    outcome, part = scanning.outcome(), scanning.part()
    used = [used for _, used in part["edges"]]  # type: ignore[attr-defined] # a list

    assert (outcome.failed, part["failed"], part["done"]) == ("", "", SWEEPS)
    assert used[:3] == [True, True, False]
    assert sum(used) == SWEEPS
    assert outcome.drives_v == pytest.approx((0.0, 5.0), abs=0.1)
    scanning.channels.close()


def test_an_edge_that_does_not_come_ends_the_scan(tmp_path: Path) -> None:
    """Where the axes are, with the sweeps so far, and the reason."""
    scanning = Scanning(tmp_path, CameraOptions(rate_hz=8.0, pulses=3))
    scanning.threads.begin_scan((0, 1), stepped())
    outcome, part = scanning.outcome(), scanning.part()
    read_v = scanning.channels.read_back(scanning.clock.now_ns())

    assert "in plane 4 of 6" in outcome.failed
    assert (part["failed"], part["done"], part["ended"]) == (outcome.failed, 3, True)
    assert outcome.drives_v == pytest.approx((0.0, 3.0), abs=0.1)
    assert outcome.drives_v == pytest.approx(read_v, abs=0.1)
    scanning.channels.close()


def test_a_table_that_leaves_the_limits_is_not_played(tmp_path: Path) -> None:
    """The guard checks each block, point by point, whoever sent it."""
    scanning = Scanning(tmp_path)
    scanning.threads.begin_scan((0, 1), table(top_v=160.0))
    outcome = scanning.outcome()

    assert "allowed range 0 to 150 V" in outcome.failed
    assert outcome.drives_v == pytest.approx((0.0, 0.0), abs=0.1)
    assert scanning.part()["failed"] == outcome.failed
    scanning.channels.close()


def test_without_a_scan_there_is_no_record(tmp_path: Path) -> None:
    """The error says so."""
    with pytest.raises(UnknownNameError, match="nothing was scanned"):
        scanned_part(tmp_path / SCANNED, tmp_path / SCANNED_ROWS, 0)
