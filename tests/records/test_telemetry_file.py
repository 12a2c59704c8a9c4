"""Recordings of every cycle: complete, readable at any time, and after any interruption."""

import errno
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.errors import DataError
from piezod.records.experiment_result import ExperimentResult
from piezod.records.recording.reader import read_telemetry
from piezod.records.recording.writer import TelemetryWriter
from tests.forked import SCRIPT, run
from tests.records.telemetry import START_NS, header, record_dtype, records


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return the path of the file that a test writes."""
    return tmp_path / "run.h5"


def write(path: Path, *portions: tuple[int, int], axes: tuple[str, ...] = ("x",)) -> None:
    """Write portions of synthetic records."""
    with TelemetryWriter(path, header(axes), record_dtype(len(axes))) as writer:
        for begin, end in portions:
            writer.append(records(begin, end, len(axes)))


def test_every_record_comes_back(file: Path) -> None:
    """For any portions, all columns of all axes are in the file to the last bit."""
    write(file, (0, 1), (1, 2500), (2500, 2500), (2500, 3001), axes=("x", "cycles"))
    expected = records(0, 3001, 2)
    read = read_telemetry(file)

    assert (read.lost, read.gaps.shape) == (0, (0, 2))
    for name in ("seq", "t_ns", "late_ns", "state"):
        np.testing.assert_array_equal(read.cycles[name], expected[name])
    for index, axis in enumerate(("x", "cycles")):
        for name in ("sample_ns", "position_um", "drive_v", "mode", "on_target"):
            np.testing.assert_array_equal(read.axes[axis][name], expected["axes"][:, index][name])
    np.testing.assert_array_equal(read.cycles["t_s"], np.arange(3001) / 1000)


def test_header_comes_back(file: Path) -> None:
    """Title, axes, instants, names of numbers and notes survive."""
    written = header(("x", "y"), {"configuration": "rate_hz: 1000  # µ", "events": ""})
    TelemetryWriter(file, written, record_dtype(2)).close()

    assert read_telemetry(file).header == written


def test_names_of_axes_in_files_of_older_versions(file: Path) -> None:
    """Where older versions have them is for data groups; such files can still be read."""
    write(file, (0, 10), axes=("x", "y"))
    with h5py.File(file, "r+") as root:
        attributes = root["recording"].attrs
        assert "axes" not in attributes
        attributes["axes"] = attributes["axis_names"]
        del attributes["axis_names"]

    assert read_telemetry(file).header.axes == ("x", "y")


def test_recording_of_a_part(file: Path) -> None:
    """A slice of time becomes the recording of an experiment, one for each axis."""
    write(file, (0, 3000), axes=("x", "y"))
    x, y = read_telemetry(file, 1.0, 1.5).recordings()

    assert (x.axis, x.mode, x.title) == ("x", "feedforward", "made up, µm")
    assert (x.t_s[0], x.t_s[-1], x.t_s.size) == (1.0, 1.499, 500)
    np.testing.assert_array_equal(y.position_um, np.arange(1000, 1500) / 7 + 1000)
    assert not x.knows_truth
    assert ExperimentResult("both", (x, y), (), "", {}, 1, 1000.0).axes == ("x", "y")


def test_weights_come_back(file: Path) -> None:
    """A slice contains its weights, for the axes with recorded weights."""
    said = replace(header(("x", "y", "z")), weights={"x": 2, "z": 4})
    with TelemetryWriter(file, said, record_dtype(3)) as writer:
        for cycle in range(0, 2000, 100):
            writer.append_weights("x", START_NS + cycle * 1_000_000, [cycle, -cycle], surface=False)
            writer.append_weights("y", START_NS, [1.0, 2.0], surface=False)
            writer.append_weights("z", START_NS, [1.0, 2.0], surface=False)
            writer.append(records(cycle, cycle + 100, 3))
    read = read_telemetry(file, 0.3, 0.5)
    x, y, z = read.recordings()

    assert read.header == said
    assert x.weights.tolist() == [[300.0, -300.0], [400.0, -400.0]]
    assert x.weights_t_s.tolist() == [0.3, 0.4]
    assert (y.weights.shape, z.weights.shape) == ((0, 0), (0, 4))
    x, _, z = read_telemetry(file).recordings()
    assert x.weights_t_s.size == 20
    assert z.weights.tolist() == [[1.0, 2.0]]


def test_recording_of_several_modes(file: Path) -> None:
    """If the mode changed, it is called mixed."""
    with TelemetryWriter(file, header(), record_dtype()) as writer:
        writer.append(records(0, 10, mode=1))
        writer.append(records(10, 20, mode=2))

    assert read_telemetry(file).recordings()[0].mode == "mixed"
    assert read_telemetry(file, 0.010).recordings()[0].mode == "adaptive"


def test_recording_of_no_time_is_refused(file: Path) -> None:
    """A slice without a sample is refused."""
    write(file, (0, 10))

    assert read_telemetry(file, 5.0).cycles["seq"].size == 0
    with pytest.raises(DataError, match="no samples"):
        read_telemetry(file, 5.0).recordings()


def test_lost_records_are_told(file: Path) -> None:
    """The file contains their number and the record before which they were lost."""
    with TelemetryWriter(file, header(), record_dtype()) as writer:
        writer.append(records(0, 1500))
        writer.append(records(1507, 1600), 7)
        writer.append(records(1600, 1600), 3)
    read = read_telemetry(file)

    assert read.lost == 10
    assert read.gaps.tolist() == [[1500, 7], [1593, 3]]
    assert read.cycles["seq"].size == 1593


def test_viewers_find_a_plot(file: Path) -> None:
    """The default leads to the position of the first axis over time, with units and names."""
    write(file, (0, 100))
    with h5py.File(file) as root:
        entry = root[root.attrs["default"]]
        group = entry[entry.attrs["default"]]
        plotted = group[group.attrs["signal"]]
        states = h5py.check_enum_dtype(entry["cycles/state"].dtype)

        assert (group.attrs["NX_class"], group.attrs["signal"]) == ("NXdata", "position_um")
        assert group[group.attrs["axes"]].shape == plotted.shape == (100,)
        assert (plotted.attrs["units"], group["t_s"].attrs["units"]) == ("um", "s")
        assert states == {"SAFE": 0, "RUN": 1}


def test_file_can_be_read_while_it_is_written(file: Path) -> None:
    """Records older than about a second are available to readers."""
    with TelemetryWriter(file, header(), record_dtype()) as writer:
        writer.append(records(0, 2500))
        meanwhile = read_telemetry(file).cycles["seq"]

    np.testing.assert_array_equal(meanwhile, np.arange(2000))
    assert read_telemetry(file).cycles["seq"].size == 2500


def test_existing_file_is_never_touched(file: Path, tmp_path: Path) -> None:
    """Neither a file nor the target of a link is overwritten."""
    target = tmp_path / "target"
    target.write_text("mine", encoding="utf-8")
    file.symlink_to(target)
    with pytest.raises(FileExistsError):
        TelemetryWriter(file, header(), record_dtype())

    assert target.read_text(encoding="utf-8") == "mine"


@pytest.mark.fault("P6")
def test_disk_without_room_for_a_file(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error of the disk is raised, and no file is left."""

    def fail(*_arguments: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", fail)
    with pytest.raises(OSError, match="No space left"):
        TelemetryWriter(file, header(), record_dtype())

    assert not file.exists()


@pytest.mark.fault("P6")
def test_failure_within_hdf5_is_an_error_of_the_disk(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any error of h5py becomes one OSError; the file is closed at the end."""

    def fail(_file: h5py.File) -> None:
        raise RuntimeError("Unable to flush")

    writer = TelemetryWriter(file, header(), record_dtype())
    with monkeypatch.context() as patch:
        patch.setattr(h5py.File, "flush", fail)
        with pytest.raises(OSError, match="Unable to flush"):
            writer.append(records(0, 1500))
    writer.close()

    assert read_telemetry(file).cycles["seq"].size == 1000


def test_file_is_not_for_everybody(file: Path) -> None:
    """Owner and group may read it, others may not."""
    write(file, (0, 1))

    assert file.stat().st_mode & 0o137 == 0


def test_foreign_file_is_refused(file: Path, tmp_path: Path) -> None:
    """An HDF5 file of another layout is refused, and so is a file of another format."""
    with h5py.File(file, "w") as root:
        root["a"] = 1
    other = tmp_path / "text.h5"
    other.write_text("text", encoding="utf-8")

    with pytest.raises(DataError, match="not the recording of a stage"):
        read_telemetry(file)
    with pytest.raises(DataError, match="not an HDF5 file"):
        read_telemetry(other)


KILLED = """
import os, signal, sys
from pathlib import Path
from piezod.records.recording.writer import TelemetryWriter
from tests.records.telemetry import header, record_dtype, records
writer = TelemetryWriter(Path(sys.argv[1]), header(), record_dtype())
for begin in range(0, 5250, 50):
    writer.append(records(begin, begin + 50))
os.kill(os.getpid(), signal.SIGKILL)
"""

FULL = """
import resource, sys
from pathlib import Path
from piezod.records.recording.writer import TelemetryWriter
from tests.records.telemetry import header, record_dtype, records
resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
writer = TelemetryWriter(Path(sys.argv[1]), header(), record_dtype())
try:
    for begin in range(0, 1_000_000, 1000):
        writer.append(records(begin, begin + 1000))
except OSError as error:
    print(error)
try:
    writer.close()
except OSError as error:
    print(error)
writer.close()
"""


@pytest.mark.fault("P8")
def test_recording_survives_a_kill(file: Path) -> None:
    """After kill -9 the file lacks about the last second only."""
    done = run((KILLED, str(file)), module=SCRIPT)

    assert done.returncode == -signal.SIGKILL, done.stderr
    np.testing.assert_array_equal(read_telemetry(file).cycles["seq"], np.arange(5000))


@pytest.mark.fault("P6")
def test_recording_survives_a_full_disk(file: Path) -> None:
    """The writer raises an error, the process ends normally, and the written part is readable."""
    # Not a fork: the ordinary end of the interpreter, with a file that HDF5 cannot close, counts.
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(file)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    seqs = read_telemetry(file).cycles["seq"]

    assert (done.returncode, done.stderr) == (0, "")
    assert os.strerror(errno.EFBIG) in done.stdout
    assert seqs.size >= 1000
    np.testing.assert_array_equal(seqs, np.arange(seqs.size))


def test_memory_does_not_grow_with_the_file(file: Path) -> None:
    """The supervisor records for days: HDF5 keeps no chunk that has been written."""
    with TelemetryWriter(file, replace(header(), rate_hz=20_000.0), record_dtype()) as writer:
        portion = records(0, 8192)
        sizes_mb = []
        for _ in range(40):
            writer.append(portion)
            pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
            sizes_mb.append(int(pages) * os.sysconf("SC_PAGESIZE") / 1e6)

    assert sizes_mb[-1] - sizes_mb[4] < 5.0


def test_file_explains_itself(file: Path) -> None:
    """With h5py alone each column shows its unit, its meaning, and the names of its numbers."""
    write(file, (0, 3))
    with h5py.File(file, "r") as root:
        entry = root["recording"]
        cycles, axis = entry["cycles"], entry["axis_x"]

        assert root.attrs["creator"] == "piezod"
        assert "one row per cycle" in entry.attrs["description"]
        assert "in force in the next" in axis.attrs["description"]
        assert cycles["late_ns"].attrs["description"] == "Wake-up after the deadline."
        assert dict(axis["drive_v"].attrs)["units"] == "V"
        assert axis["drive_v"].attrs["description"] == "Written voltage."
        assert list(cycles["state"].attrs["values"]) == ["0 = SAFE", "1 = RUN"]
        assert list(cycles["seq"].attrs["bits"]) == ["0 = S1", "1 = A2"]
        assert cycles["t_s"].attrs["description"] == "Instant of the cycle since `start_ns`."
        undescribed = [
            group.name
            for group in entry.values()
            if group.attrs.get("NX_class") == "NXdata" and not group.attrs["description"]
        ]
        assert undescribed == []


def test_axis_with_a_surface_comes_back(file: Path) -> None:
    """The header names the axes whose weights have no sides, and their group describes them."""
    said = replace(header(("x", "y")), weights={"x": 24, "y": 24}, surfaces=("y",))
    with TelemetryWriter(file, said, record_dtype(2)) as writer:
        writer.append(records(0, 100, 2))
    read = read_telemetry(file)

    assert read.header == said
    assert [each.surface for each in read.recordings()] == [False, True]
    with h5py.File(file) as opened:
        about = opened["recording/weights_y"].attrs["description"]
        assert "of a surface, see `weights_form`, the coefficients" in about
        forms = opened["recording/weights_y/weights_form"].attrs["values"]
        assert list(forms) == ["0 = stops", "1 = surface"]


@pytest.fixture
def adopted(file: Path) -> Path:
    """Return a recording in which an axis with 12 stops on each side adopts a surface at 0.2 s."""
    said = replace(header(("x",)), weights={"x": 24})
    with TelemetryWriter(file, said, record_dtype()) as writer:
        for cycle in range(0, 400, 100):
            # The surface begins with the numbers of the stops: its form alone is a change.
            weights, surface = np.full(24, cycle // 300), cycle >= 200
            writer.append_weights("x", START_NS + cycle * 1_000_000, weights, surface=surface)
            writer.append(records(cycle, cycle + 100))
    return file


def test_each_row_of_weights_has_its_form(adopted: Path) -> None:
    """Weights of stops and coefficients of a surface are told apart, though both are 24."""
    weights = read_telemetry(adopted).weights["x"]

    assert weights["weights_form"].tolist() == [0, 1, 1]
    assert weights["weights_t_s"].tolist() == [0.0, 0.2, 0.3]


def test_weights_of_two_forms_are_not_mixed(adopted: Path) -> None:
    """A recording, or a part of one, has the weights of the form with which it begins."""
    (whole,), (part,) = (read_telemetry(adopted, at).recordings() for at in (0.0, 0.2))

    assert (whole.surface, part.surface) == (False, True)
    assert (whole.weights_t_s.tolist(), part.weights_t_s.tolist()) == ([0.0], [0.2, 0.3])


def test_weights_of_a_longer_model_are_kept(file: Path) -> None:
    """A model that was adopted has its own number of weights; those of the first are not mixed."""
    said = replace(header(("x",)), weights={"x": 2})
    with TelemetryWriter(file, said, record_dtype()) as writer:
        for at, weights in enumerate(([1.0, 2.0], [3.0, 4.0, 5.0, 6.0])):
            t_ns = START_NS + at * 1_000_000_000
            writer.append_weights("x", t_ns, weights, surface=False)
            writer.append(records(1000 * at, 1000 * at + 1000))
            meanwhile = read_telemetry(file).weights["x"]["weights"]
            assert meanwhile[-1][: len(weights)].tolist() == weights
    read = read_telemetry(file)

    assert read.header == said
    assert read.weights["x"]["weights"].shape == (2, 4)
    assert read.first_weights("x")[0].tolist() == [[1.0, 2.0]]
    assert read.first_weights("x", 1.0, 2.0)[0].tolist() == [[3.0, 4.0, 5.0, 6.0]]


def test_file_without_forms_has_that_of_its_start(adopted: Path) -> None:
    """Files from before the forms were recorded can be read; all rows have the form of the axis."""
    with h5py.File(adopted, "r+") as opened:
        del opened["recording/weights_x/weights_form"]
        opened["recording/weights_x"].attrs["surface"] = True
    read = read_telemetry(adopted)

    assert read.weights["x"]["weights_form"].tolist() == [1] * 3
    assert read.recordings()[0].surface
