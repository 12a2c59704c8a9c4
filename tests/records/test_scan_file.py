"""A scan on the disk: its pictures and lists, also after its writer was killed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.records.figures.scan import scan_figure
from piezod.records.scan_file import (
    ScanFile,
    ScanHeader,
    SweptPixels,
    SweptPulses,
    is_scan,
    read_scan,
)

CENTRES = (np.linspace(0.5, 3.5, 4), np.linspace(10.5, 12.5, 3))
KILLED = """
import os, signal, sys
from pathlib import Path
from tests.records.test_scan_file import new_file, sweep
file = new_file(Path(sys.argv[1]))
for row in range(2):
    file.append(sweep(row))
os.kill(os.getpid(), signal.SIGKILL)
"""


def header(*inputs: str, both_ways: bool = False) -> ScanHeader:
    """Return the header of a raster of x and y."""
    return ScanHeader("a scan", "2026-01-01T00:00:00+00:00", ("x", "y"), inputs, both_ways)


def new_file(path: Path, head: ScanHeader | None = None) -> ScanFile:
    """Return a new file of 4 x 3 pixels."""
    return ScanFile(path, head or header("photons"), CENTRES, 3, 4)


def sweep(row: int, *, backward: bool = False) -> SweptPixels:
    """Return a sweep; the first pixel in time has the smallest count."""
    n = np.arange(4)
    counts = n.astype(np.float64)
    return SweptPixels(
        row,
        backward,
        np.stack((counts + 0.5, np.full(4, 10.5 + row)), axis=1),
        np.asarray(0.01 * counts, np.float64),
        np.asarray(100.0 * row + counts[:, None], np.float64),
        0.001,
        1000 * n,
        1000 * n + 999,
    )


def test_pictures_have_rows_and_lists_have_time(tmp_path: Path) -> None:
    """A backward sweep is turned in the picture, and not in the list."""
    path = tmp_path / "scan.nxs"
    with new_file(path) as file:
        file.append(sweep(0))
        file.append(sweep(1, backward=True))
    stored = read_scan(path)

    assert stored.pictures["photons"][:2].tolist() == [[0, 1, 2, 3], [103, 102, 101, 100]]
    assert np.isnan(stored.pictures["photons"][2]).all()
    assert [name for name, _ in stored.scales] == ["y_um", "x_um"]
    with h5py.File(path) as opened:
        lists = opened["scan/pixels"]
        assert lists["photons"][()].tolist() == [0, 1, 2, 3, 100, 101, 102, 103]
        assert lists["column"][()].tolist() == [0, 1, 2, 3, 3, 2, 1, 0]
        assert lists["position_x_um"][()].tolist() == 2 * [0.5, 1.5, 2.5, 3.5]
        assert opened["scan"].attrs["default"] == "picture"
        assert opened["scan/picture"].attrs["signal"] == "photons"
        assert opened["scan/picture/x_um"][()].tolist() == [0.5, 1.5, 2.5, 3.5]


def test_lines_that_are_swept_both_ways_have_two_pictures(tmp_path: Path) -> None:
    """Without an input beside they show the error."""
    path = tmp_path / "scan.nxs"
    with new_file(path, header(both_ways=True)) as file:
        file.append(sweep(0))
        file.append(sweep(0, backward=True))
    pictures = read_scan(path).pictures

    assert list(pictures) == ["error_um", "error_um_backward"]
    assert pictures["error_um_backward"][0] == pytest.approx(pictures["error_um"][0][::-1])


def test_a_path_is_a_list_of_places(tmp_path: Path) -> None:
    """A viewer shows its signal over both axes; the figure has a dot for each pixel."""
    path, places = tmp_path / "scan.nxs", (np.linspace(0.0, 3.0, 4), np.linspace(5.0, 8.0, 4))
    with ScanFile(path, header("photons")._replace(path=True), places, 1, 4) as file:
        empty = read_scan(path).pictures["photons"]
        file.append(sweep(0))
    stored = read_scan(path)
    (dots,) = scan_figure(stored).axes[0].collections

    assert np.isnan(empty).all()
    assert stored.pictures["photons"].tolist() == [0, 1, 2, 3]
    assert [(name, values.tolist()) for name, values in stored.scales] == [
        ("x_um", places[0].tolist()),
        ("y_um", places[1].tolist()),
    ]
    assert np.asarray(dots.get_offsets()).tolist() == np.stack(places, axis=1).tolist()


def test_pulses_at_positions_are_columns(tmp_path: Path) -> None:
    """With the way they came about; a sweep without one adds none."""
    path, at = tmp_path / "scan.nxs", np.array([7.0, 8.0])
    pulses = SweptPulses(np.array([10, 20]), at, 0.1 * at, np.full(2, np.nan))
    with new_file(path, header("photons")._replace(pulses="compared by the device")) as file:
        file.append(sweep(0), pulses)
        file.append(sweep(1), SweptPulses(np.empty(0, np.int64), at[:0], at[:0], at[:0]))
    with h5py.File(path) as opened:
        group = opened["scan/pulses"]
        found = [group[name][()] for name in SweptPulses._fields]

        assert group.attrs["way"] == "compared by the device"
    assert np.array_equal(found, np.stack(pulses), equal_nan=True)


def test_a_killed_writer_leaves_all_sweeps_before(tmp_path: Path) -> None:
    """The file can be read at once, and its figure drawn."""
    path = tmp_path / "scan.nxs"
    command = [sys.executable, "-c", KILLED, str(path)]
    ended = subprocess.run(command, check=False, cwd=Path(__file__).parents[2])

    assert ended.returncode == -signal.SIGKILL
    assert is_scan(path)
    stored = read_scan(path)
    assert stored.pictures["photons"][1].tolist() == [100, 101, 102, 103]
    assert len(scan_figure(stored).axes) == 2


def test_an_existing_file_is_not_replaced(tmp_path: Path) -> None:
    """What was measured cannot be computed again."""
    path = tmp_path / "scan.nxs"
    path.write_text("data")
    with pytest.raises(FileExistsError):
        new_file(path)

    assert path.read_text() == "data"
    assert not is_scan(path)


@pytest.mark.parametrize("sweeps", [20, 200])
def test_memory_does_not_grow(tmp_path: Path, sweeps: int) -> None:
    """What a sweep needs is given back, however many there are."""
    edges = np.linspace(0.0, 1.0, 1001), np.linspace(0.0, 1.0, sweeps + 1)
    n = np.arange(1000)
    pixels = SweptPixels(
        0, False, np.zeros((1000, 2)), np.zeros(1000), np.zeros((1000, 1)), 0.001, n, n
    )
    with ScanFile(tmp_path / "scan.nxs", header("photons"), edges, sweeps, 1000) as file:
        file.append(pixels)
        before = _resident_bytes()
        for row in range(1, sweeps):
            file.append(pixels._replace(row=row))
        grown = _resident_bytes() - before

    assert grown < 4_000_000


def _resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
