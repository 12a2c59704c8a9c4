"""Recordings that wait for the rising edge of a line."""

import json
from pathlib import Path

import numpy as np
import pytest

from piezod.daemon.stores.edge_source import Trigger
from piezod.daemon.stores.recorder import Recorder
from piezod.records.recording.reader import read_telemetry
from piezod.telemetry.arrays import Records
from piezod.telemetry.record import StageEvent
from tests.daemon.fake_ring import FakeRing
from tests.daemon.waiting import eventually
from tests.records.telemetry import START_NS, header

MS = 1_000_000
"""The period of the ring, in ns."""


@pytest.fixture
def ring() -> FakeRing:
    """Return a ring that has run for 3 s before; its line is high from cycle 5000 to 5299."""
    ring = FakeRing(10_000)
    ring.high = range(5000, 5300)
    ring.run(3000)
    return ring


@pytest.mark.parametrize(
    ("trigger", "cycles"),
    [
        (Trigger("exposed", 0, 0.0, None), range(5000, 5301)),
        (Trigger("exposed", 0, 2.5, None), range(2500, 5301)),
        (Trigger("exposed", 0, 0.5, 1.0), range(4500, 6001)),
    ],
)
def test_file_has_the_time_around_the_pulse(
    recorder: Recorder, ring: FakeRing, trigger: Trigger, cycles: range
) -> None:
    """It begins before the edge, which is its time 0, and ends at the other edge or in time."""
    name = recorder.start(header(), trigger=trigger)
    ring.events.append(StageEvent(START_NS + 4000 * MS, "info", "state", "before"))
    assert recorder.status.armed
    for _ in range(7):
        ring.run(617)
    eventually(lambda: not recorder.status.recording)
    found = read_telemetry(recorder.folder.path_of(name))

    np.testing.assert_array_equal(found.cycles["seq"], cycles)
    np.testing.assert_allclose(found.cycles["t_s"], (np.array(cycles) - 5000) / 1000, atol=1e-9)
    assert found.header.start_ns == START_NS + 5000 * MS
    assert found.header.started_at == "2024-05-01T12:00:05.000+00:00"
    told = json.loads(found.header.notes["trigger"])
    assert (told["line"], told["edge_ns"]) == ("exposed", START_NS + 5000 * MS)
    assert [each.text for each in found.events] == ["before"]
    assert (recorder.status.records, recorder.status.lost) == (len(cycles), 0)


def test_line_that_is_high_already_has_no_edge(recorder: Recorder, ring: FakeRing) -> None:
    """The next rising edge counts; without one there is no file, and the status says why."""
    ring.high = range(6000)
    recorder.start(header(), trigger=Trigger("exposed", 0, 1.0, None))
    ring.run(5000)
    eventually(lambda: recorder.status.armed)
    ended = recorder.stop()

    assert not ended.recording
    assert "exposed" in ended.why
    assert recorder.folder.files() == ()


def test_another_recording_follows_one_that_an_edge_has_ended(
    recorder: Recorder, ring: FakeRing
) -> None:
    """The recorder is free again without a request to stop."""
    recorder.start(header(), trigger=Trigger("exposed", 0, 0.0, None))
    ring.run(4000)
    eventually(lambda: not recorder.status.recording)
    recorder.start(header(), "next")
    ring.run(10)
    eventually(lambda: recorder.status.records == 10)

    assert recorder.stop().why == ""


def test_failure_before_the_file_is_told(ring: FakeRing, tmp_path: Path) -> None:
    """The recorder is free again, whatever ends the wait."""

    def fails(_count: int) -> Records:
        raise ValueError("the ring is gone")

    recorder = Recorder(ring.stage._replace(last=fails), tmp_path / "recordings", lambda _: "")
    recorder.start(header(), trigger=Trigger("exposed", 0, 1.0, None))
    ring.run(4000)
    eventually(lambda: not recorder.status.recording)

    assert not recorder.status.armed
    assert "the ring is gone" in recorder.stop().why
