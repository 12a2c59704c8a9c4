"""The recorder: every cycle is recorded or counted as lost, and the loop is never disturbed."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from piezod.daemon.stores import recorded_files
from piezod.daemon.stores.recorder import Recorder, RecorderError
from piezod.daemon.stores.recording_limits import no_room
from piezod.messages.stores import Recording
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry
from piezod.records.recording.writer import TelemetryWriter
from tests.daemon.fake_ring import FakeRing
from tests.daemon.waiting import eventually
from tests.forked import SCRIPT, run
from tests.records.telemetry import START_NS, header


class Disk:
    """Returns why the disk is too full."""

    def __init__(self) -> None:
        self.why = ""

    def __call__(self, _folder: Path) -> str:
        return self.why


@pytest.fixture
def ring() -> FakeRing:
    """Return a ring with some records."""
    ring = FakeRing(5000)
    ring.run(300)
    return ring


@pytest.fixture
def disk() -> Disk:
    """Return a disk with free space."""
    return Disk()


@pytest.fixture
def recorder(ring: FakeRing, disk: Disk, tmp_path: Path) -> Iterator[Recorder]:
    """Return a recorder, which is stopped at the end."""
    folder = tmp_path / "recordings"
    recorder = Recorder(ring.stage, folder, disk)
    yield recorder
    recorder.stop()


def read(recorder: Recorder) -> RecordedTelemetry:
    """Return the contents of the last recording."""
    path = recorder.folder.find(recorder.status.name)
    assert path is not None
    return read_telemetry(path)


def test_every_cycle_is_recorded(recorder: Recorder, ring: FakeRing) -> None:
    """No cycle between start and stop is missing."""
    name = recorder.start(header(), "all")
    for _ in range(7):
        ring.run(1111)
        eventually(lambda: recorder.status.records == ring.newest - 300)
    ring.run(13)
    status = recorder.stop()
    recorded = read(recorder)

    assert name.endswith("Z-all")
    assert status == Recording(False, name, 7790, 0, "")
    assert recorded.lost == 0
    assert recorded.header == replace(header(), weights={"x": 2})
    np.testing.assert_array_equal(recorded.cycles["seq"], np.arange(300, 8090))


def test_recording_begins_at_its_instant(recorder: Recorder, ring: FakeRing) -> None:
    """Cycles before the instant are not recorded, nor counted as lost."""
    recorder.start(header(), begins_ns=START_NS + 800_000_000)
    ring.run(2000)
    recorder.stop()
    recorded = read(recorder)

    assert recorded.lost == 0
    np.testing.assert_array_equal(recorded.cycles["seq"], np.arange(800, 2300))


def test_weights_are_recorded_when_they_change(recorder: Recorder, ring: FakeRing) -> None:
    """Weights are stored once per change, with the instant of the newest cycle."""
    recorder.start(header())
    for _ in range(3):
        ring.run(1000)
        eventually(lambda: recorder.status.records == ring.newest - 300)
    ring.weights["x"] = [0.5, -0.25]
    ring.run(1)
    recorder.stop()
    (recording,) = read(recorder).recordings()

    assert recording.weights.tolist() == [[1.0, 2.0], [0.5, -0.25]]
    assert recording.weights_t_s[1] == recording.t_s[-1]


def test_form_of_the_weights_is_recorded(recorder: Recorder, ring: FakeRing) -> None:
    """A model of the other form that is adopted during a recording shows in it."""
    recorder.start(header())
    ring.run(1000)
    eventually(lambda: recorder.status.records == ring.newest - 300)
    ring.surfaces.add("x")
    ring.run(1)
    recorder.stop()
    recorded = read(recorder)

    assert recorded.header.surfaces == ()
    assert recorded.weights["x"]["weights_form"].tolist() == [0, 1]
    assert recorded.weights["x"]["weights"].tolist() == [[1.0, 2.0]] * 2


def test_recordings_follow_each_other(recorder: Recorder, ring: FakeRing) -> None:
    """The next recording begins with the next cycle, in a new file."""
    names = []
    for _ in range(2):
        names.append(recorder.start(header()))
        ring.run(100)
        recorder.stop()
        ring.run(1000)

    assert len(set(names)) == 2
    assert {each.name for each in recorder.folder.files()} == set(names)
    np.testing.assert_array_equal(read(recorder).cycles["seq"], np.arange(1400, 1500))


def test_one_recording_at_a_time(recorder: Recorder) -> None:
    """A second start is refused, and the first recording continues."""
    name = recorder.start(header())
    with pytest.raises(RecorderError, match=f"recording {name} is running; stop it first"):
        recorder.start(header())

    assert recorder.status.recording


def test_stop_without_a_start(recorder: Recorder) -> None:
    """A stop without a recording does nothing."""
    assert recorder.stop() == Recording(False, "", 0, 0, "")


def test_label_that_is_not_allowed(recorder: Recorder) -> None:
    """An invalid label is refused, and nothing is recorded."""
    with pytest.raises(ValueError, match="label"):
        recorder.start(header(), "../x")

    assert not recorder.status.recording


def test_folder_that_is_gone(recorder: Recorder) -> None:
    """A start without the folder fails, and can be repeated."""
    recorder.folder.path.rmdir()
    with pytest.raises(RecorderError, match="No such file"):
        recorder.start(header())
    recorder.folder.path.mkdir()

    assert recorder.start(header())


@pytest.mark.fault("P6")
def test_nothing_is_recorded_on_a_full_disk(recorder: Recorder, disk: Disk) -> None:
    """A start is refused with the free space and the remedy."""
    disk.why = "12 MB are free"
    with pytest.raises(RecorderError, match="12 MB are free"):
        recorder.start(header())

    assert recorder.folder.files() == ()


@pytest.mark.fault("P6")
def test_recording_ends_before_the_disk_is_full(
    recorder: Recorder, ring: FakeRing, disk: Disk
) -> None:
    """If the free space gets too small, it ends cleanly; `stop` returns the reason once."""
    recorder.start(header())
    ring.run(100)
    disk.why = "12 MB are free"
    eventually(lambda: not recorder.status.recording)

    assert recorder.status == Recording(False, recorder.status.name, 100, 0, "12 MB are free", True)
    assert read(recorder).cycles["seq"].size == 100
    first, second = recorder.stop(), recorder.stop()
    assert (first.records, first.why, first.disk_full) == (100, "12 MB are free", True)
    assert (second.records, second.why, second.disk_full) == (100, "", False)
    disk.why = ""
    assert recorder.start(header()) == recorder.status.name
    assert not recorder.status.disk_full


@pytest.mark.fault("P6")
def test_room_that_is_left_for_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """500 MB or 5 % of the disk stay free, whichever is more."""
    usages = {
        "small": (10e9, 0, 0.51e9),
        "small, full": (10e9, 0, 0.49e9),
        "large": (100e9, 0, 5.1e9),
        "large, full": (100e9, 0, 4.9e9),
    }
    found = {}
    for name, usage in usages.items():
        disk_usage = type("Usage", (), dict(zip(("total", "used", "free"), usage, strict=True)))
        monkeypatch.setattr(shutil, "disk_usage", lambda _, it=disk_usage: it)
        found[name] = no_room(tmp_path)

    assert found["small"] == found["large"] == ""
    assert "490 MB are free" in found["small, full"]
    assert "5000 MB must stay free; delete recordings" in found["large, full"]


class StallingWriter(TelemetryWriter):
    """A file on a disk that stalls: the first records are written when the gate opens."""

    gate = Event()
    reached = Event()

    def append(self, records: NDArray[Any], lost: int = 0) -> None:
        if len(records):
            self.reached.set()
            assert self.gate.wait(60)
        super().append(records, lost)


@pytest.mark.fault("P7")
def test_stalled_disk_costs_records_that_are_counted(
    recorder: Recorder, ring: FakeRing, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ring overwrites its oldest records meanwhile; the file has the number of lost ones."""
    monkeypatch.setattr(recorded_files, "TelemetryWriter", StallingWriter)
    recorder.start(header())
    ring.run(100)
    assert StallingWriter.reached.wait(60)
    ring.run(7000)
    StallingWriter.gate.set()
    status = recorder.stop()
    recorded = read(recorder)

    assert status == Recording(False, status.name, 5100, 2000, "")
    assert recorded.lost == 2000
    assert recorded.gaps.tolist() == [[100, 2000]]
    np.testing.assert_array_equal(np.diff(recorded.cycles["seq"]).max(), 2001)


def test_any_failure_ends_a_recording_with_the_reason(
    recorder: Recorder, ring: FakeRing, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any exception in the thread is in the status."""

    def fail(*_arguments: object) -> None:
        raise RuntimeError("Unable to flush")

    monkeypatch.setattr(TelemetryWriter, "append", fail)
    recorder.start(header())
    ring.run(1)
    eventually(lambda: not recorder.status.recording)

    assert recorder.status.why == "the file cannot be written: Unable to flush"
    assert not recorder.status.disk_full


FULL = """
import resource, sys
from pathlib import Path
from piezod.daemon.stores.recorder import Recorder
from tests.daemon.fake_ring import EndlessReader, FakeRing
from tests.daemon.waiting import eventually
from tests.records.telemetry import header
resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, 2_000_000))
stage = FakeRing().stage._replace(open_reader=EndlessReader)
recorder = Recorder(stage, Path(sys.argv[1]), no_room=lambda folder: "")
recorder.start(header())
eventually(lambda: not recorder.status.recording)
ended = recorder.stop()  # waits for the thread, which still logs its end
print(ended.why, ended.disk_full)
"""


@pytest.mark.fault("P6")
def test_file_that_cannot_grow(tmp_path: Path) -> None:
    """The recording ends with the reason, the process runs on, and the file can be read."""
    done = run((FULL, str(tmp_path)), module=SCRIPT)
    (path,) = tmp_path.iterdir()
    seqs = read_telemetry(path).cycles["seq"]

    assert done.returncode == 0, done.stderr
    assert "File too large" in done.stdout
    assert done.stdout.rstrip().endswith("True")
    assert seqs.size >= 1000
    np.testing.assert_array_equal(seqs, np.arange(seqs.size))
