"""Recordings in several files, with events and models, and the limit of their folder."""

import errno
import os
import signal
from math import inf
from pathlib import Path

import numpy as np
import pytest

from piezod.daemon.stores.recorder import Recorder
from piezod.daemon.stores.recording_limits import RecordingLimits
from piezod.records.recording.joined import joined
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry
from piezod.telemetry.record import StageEvent
from tests import forked
from tests.daemon.fake_ring import FakeRing
from tests.daemon.waiting import eventually
from tests.records.telemetry import START_NS, header

EVERY_SECOND = RecordingLimits(file_s=1.0)


@pytest.fixture
def ring() -> FakeRing:
    """Return a ring that has run before the recording."""
    ring = FakeRing(50_000)
    ring.run(300)
    return ring


def run(recorder: Recorder, ring: FakeRing, cycles: int) -> None:
    """Run the stage until all cycles are recorded."""
    before = recorder.status.records
    ring.run(cycles)
    eventually(lambda: recorder.status.records == before + cycles)


def files(recorder: Recorder) -> list[RecordedTelemetry]:
    """Return the contents of all files, oldest first."""
    names = [each.name for each in recorder.folder.files()]
    return [read_telemetry(recorder.folder.path_of(name)) for name in reversed(names)]


def test_recording_goes_on_in_the_next_file(recorder: Recorder, ring: FakeRing) -> None:
    """Each file ends after its time, no cycle is missing, and all files have one time."""
    name = recorder.start(header(), "long", EVERY_SECOND)
    for _ in range(7):
        run(recorder, ring, 500)
    status = recorder.stop()
    found = files(recorder)

    names = [each.name for each in reversed(recorder.folder.files())]
    assert names == [name, f"{name}-0002", f"{name}-0003", f"{name}-0004"]
    assert (status.name, status.records, status.lost, status.files) == (name, 3500, 0, 4)
    assert [each.header.part for each in found] == [1, 2, 3, 4]
    assert [each.cycles["t_s"].size for each in found] == [1000, 1000, 1000, 500]
    whole = joined(found)
    np.testing.assert_array_equal(whole.cycles["seq"], np.arange(300, 3800))
    np.testing.assert_array_equal(whole.cycles["t_s"], np.arange(300, 3800) / 1000)
    np.testing.assert_array_equal(whole.axes["x"]["position_um"], np.arange(300, 3800) / 7)


def test_file_ends_at_its_size(recorder: Recorder, ring: FakeRing) -> None:
    """The next records after the size was reached are in the next file."""
    recorder.start(header(), limits=RecordingLimits(file_bytes=30_000))
    for _ in range(8):
        run(recorder, ring, 1000)
    status = recorder.stop()
    sizes = [each.size_bytes for each in recorder.folder.files()]

    assert status.files == len(sizes) > 2
    assert all(30_000 <= size < 200_000 for size in sizes[1:])
    np.testing.assert_array_equal(joined(files(recorder)).cycles["seq"], np.arange(300, 8300))


def test_each_file_has_the_model_in_use(recorder: Recorder, ring: FakeRing) -> None:
    """An adopted model is in the file in which it was adopted, and at the start of the next."""
    ring.models = {"x": "# first\n"}
    ring.weights["x"] = [1.0, 2.0]
    recorder.start(header(), limits=EVERY_SECOND)
    run(recorder, ring, 500)
    ring.models = {"x": "# second\n"}
    ring.weights["x"] = [3.0, 4.0, 5.0, 6.0]
    run(recorder, ring, 500)
    run(recorder, ring, 500)
    recorder.stop()
    first, second = files(recorder)

    assert first.header.notes["model_x"] == "# first\n"
    assert [(each.axis, each.text) for each in first.adopted] == [("x", "# second\n")]
    assert second.header.notes["model_x"] == "# second\n"
    assert second.adopted == ()
    assert (first.header.weights["x"], second.header.weights["x"]) == (2, 4)
    assert joined([first, second]).weights["x"]["weights"].shape == (3, 4)


def test_events_of_the_recording_are_in_it(recorder: Recorder, ring: FakeRing) -> None:
    """Events from before the start are left out, those until the stop are in the file."""
    events = [StageEvent(START_NS + at, "info", "state", f"event {at}") for at in range(4)]
    ring.events.append(events[0])
    recorder.start(header())
    ring.events.append(events[1])
    run(recorder, ring, 100)
    ring.events.extend(events[2:])
    recorder.stop()
    (found,) = files(recorder)

    assert [each.text for each in found.events] == ["event 1", "event 2", "event 3"]


def test_lost_events_are_told(recorder: Recorder, ring: FakeRing) -> None:
    """If events come faster than they are read, the recording says how many it lacks."""

    class LosingEvents:
        def __init__(self) -> None:
            self.left = [StageEvent(START_NS, "info", "state", "RUN to HOLD")]

        def read(self) -> tuple[list[StageEvent], int]:
            found, self.left = self.left, []
            return found, 7 if found else 0

    stage = ring.stage._replace(open_events=LosingEvents)
    other = Recorder(stage, recorder.folder.path, lambda _folder: "")
    other.start(header())
    run(other, ring, 10)
    other.stop()
    (found,) = files(other)

    assert [each.text for each in found.events] == [
        "RUN to HOLD",
        "7 events before this one were lost",
    ]


def test_oldest_files_make_room(recorder: Recorder, ring: FakeRing) -> None:
    """Files of earlier recordings go first, except a kept one and the one that is written."""
    names = []
    for _ in range(4):
        names.append(recorder.start(header()))
        run(recorder, ring, 2000)
        recorder.stop()
    size_bytes = recorder.folder.files()[0].size_bytes
    assert recorder.folder.keep(names[0], True)
    limits = RecordingLimits(total_bytes=2.5 * size_bytes)
    writing = recorder.start(header(), limits=limits)
    left = {each.name: each.kept for each in recorder.folder.files()}

    assert left == {names[0]: True, writing: False} | (
        {names[3]: False} if recorder.folder.find(names[3]) else {}
    )
    assert recorder.folder.find(names[1]) is None
    assert recorder.folder.find(names[2]) is None


def test_limit_of_the_folder(recorder: Recorder) -> None:
    """Only as many files are removed as needed; kept ones beyond the limit are a reason to end."""
    folder = recorder.folder
    names = [f"20240501T12000{second}Z" for second in range(5)]
    for name in names:
        folder.path_of(name).write_bytes(bytes(1_000_000))

    assert folder.limit(inf, "") == folder.limit(5e6, "") == ""
    assert len(folder.files()) == 5
    assert folder.limit(3.5e6, names[0]) == ""
    assert [each.name for each in folder.files()] == [names[4], names[3], names[0]]
    folder.keep(names[3], True)
    why = folder.limit(1e6, names[0])
    assert [each.name for each in folder.files()] == [names[3], names[0]]
    assert why.startswith("the recordings that may not be removed have 2 MB, and 1 MB are allowed")


def test_mark_of_a_recording_holds_for_its_files(recorder: Recorder) -> None:
    """The mark of a file holds for that file only, and can be removed."""
    folder, name = recorder.folder, "20240501T120000Z-a"
    for each in (name, f"{name}-0002", f"{name}-0003"):
        folder.path_of(each).touch()

    def kept() -> list[bool]:
        return [each.kept for each in reversed(folder.files())]

    assert folder.keep(f"{name}-0002", True)
    assert kept() == [False, True, False]
    assert folder.keep(f"{name}-0002", False)
    assert kept() == [False] * 3
    assert folder.keep(name, True)
    assert kept() == [True] * 3
    assert not folder.keep("20240501T120000Z-b", True)


@pytest.mark.fault("P6")
def test_recording_beyond_the_limit_ends(recorder: Recorder) -> None:
    """A single file that is larger than all recordings may be ends with the reason and a fault."""
    recorder.start(header(), limits=RecordingLimits(total_bytes=1000))
    eventually(lambda: not recorder.status.recording)

    assert "fetch and delete some, or raise max_total_mb" in recorder.status.why
    assert recorder.status.disk_full


@pytest.mark.fault("P6")
def test_disk_without_room_for_the_next_file(
    recorder: Recorder, ring: FakeRing, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The recording ends with the reason, and the file before is complete."""
    recorder.start(header(), limits=EVERY_SECOND)
    run(recorder, ring, 1000)

    def fail(*_arguments: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", fail)
    ring.run(500)
    eventually(lambda: not recorder.status.recording)
    (found,) = files(recorder)

    assert "No space left" in recorder.status.why
    assert (recorder.status.disk_full, recorder.status.files) == (True, 1)
    np.testing.assert_array_equal(found.cycles["seq"], np.arange(300, 1300))


KILLED = """
import os, signal, sys
from pathlib import Path
from piezod.daemon.stores.recorder import Recorder
from piezod.daemon.stores.recording_limits import RecordingLimits
from piezod.telemetry.record import StageEvent
from tests.daemon.fake_ring import FakeRing
from tests.daemon.waiting import eventually
from tests.records.telemetry import START_NS, header
ring = FakeRing(50_000)
ring.models = {"x": "# first"}
recorder = Recorder(ring.stage, Path(sys.argv[1]), lambda folder: "")
recorder.start(header(), "long", RecordingLimits(file_s=2.0))
for second in range(5):
    ring.events.append(StageEvent(START_NS + second * 10**9, "info", "state", str(second)))
    ring.models = {"x": f"# model {second}"}
    ring.run(1000)
    eventually(lambda: recorder.status.records == ring.newest)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.fault("P8")
def test_files_survive_a_kill(tmp_path: Path) -> None:
    """After kill -9 all files can be read up to the last second, with events and models."""
    done = forked.run((KILLED, str(tmp_path)), module=forked.SCRIPT)
    found = [
        read_telemetry(path) for path in sorted(tmp_path.iterdir(), key=lambda path: path.stem)
    ]

    assert done.returncode == -signal.SIGKILL, done.stderr
    assert [each.cycles["seq"].size for each in found] == [2000, 2000, 1000]
    whole = joined(found)
    np.testing.assert_array_equal(whole.cycles["seq"], np.arange(5000))
    assert [event.text for event in whole.events] == ["0", "1", "2", "3", "4"]
    texts = [*(each.text for each in whole.adopted), found[2].header.notes["model_x"]]
    assert {f"# model {second}" for second in range(5)} <= {
        *texts,
        *(each.header.notes["model_x"] for each in found),
    }
