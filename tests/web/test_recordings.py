"""What the page gets of recordings, and how they are read."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezod.records.telemetry_file import TelemetryWriter
from piezod.telemetry.arrays import record_dtype
from piezod.web.recording_cache import RecordingCache
from piezod.web.recording_worker import RecordingWorker
from tests.daemon.service.fakes import Served
from tests.records.telemetry import START_NS, header
from tests.web.browser import Web

NAME = "20240501T120000Z-scan"
SPIKE_UM = 9.0


@pytest.fixture
def recording(daemon: Served) -> Path:
    """Return a recording of 2 s in the folder of the daemon, with one spike."""
    made = np.zeros(2000, record_dtype(1))
    made["seq"] = np.arange(2000)
    made["t_ns"] = START_NS + np.arange(2000) * 1_000_000
    made["axes"][:, 0]["in_force_v"] = np.arange(2000) / 20
    made["axes"][1234, 0]["position_um"] = SPIKE_UM
    path = daemon.stage.recordings_folder / f"{NAME}.h5"
    with TelemetryWriter(path, header(), record_dtype(1)) as writer:
        writer.append(made, 0)
    return path


def wanted(daemon: Served, what: str, **more: Any) -> dict[str, Any]:
    """Return a request to the process that reads recordings."""
    span = {"begin_s": None, "end_s": None, "points": 100}
    return {"socket": str(daemon.socket), "recording": NAME, "what": what, **span, **more}


def test_the_page_reads_a_recording(web: Web, recording: Path) -> None:
    """Contents, a column with its spike, marks and the loop arrive over the WebSocket."""
    assert recording.is_file()
    of = {"stage": "bench", "recording": NAME}
    with web.tab() as tab:
        contents = tab.ask(do="contents", **of)["result"]
        column = tab.ask(do="view", column="axis_x/position_um", points=50, **of)["result"]
        marks = tab.ask(do="marks", axis="x", **of)["result"]
        loop = tab.ask(do="loop", axis="x", begin_s=1, end_s=1.1, **of)["result"]

    assert (contents["rows"], contents["axes"]) == (2000, ["x"])
    assert max(column["maximum"]) == SPIKE_UM
    assert len(column["begin_s"]) <= 50
    assert marks == []
    assert loop["drive_v"] == [row / 20 for row in range(1000, 1100)]


@pytest.mark.parametrize("name", ["20240501T120000Z-none", "../../etc/passwd", ""])
def test_an_unknown_recording_is_refused(web: Web, recording: Path, name: str) -> None:
    """Only names in the list of the daemon are read, so none leads out of its folder."""
    assert recording.is_file()
    with web.tab() as tab:
        answer = tab.ask(do="contents", stage="bench", recording=name)

    assert (answer["ok"], answer["error"]["code"]) == (False, "recording")
    assert "no recording" in answer["error"]["what"]


def test_an_unknown_column_is_refused_and_the_next_request_answered(
    web: Web, recording: Path
) -> None:
    """The process that reads survives what it cannot read."""
    assert recording.is_file()
    of = {"stage": "bench", "recording": NAME}
    with web.tab() as tab:
        refused = tab.ask(do="view", column="axis_x/none", **of)
        answered = tab.ask(do="view", column="axis_x/drive_v", **of)

    assert "no column 'axis_x/none'" in refused["error"]["what"]
    assert answered["ok"]


def test_a_recording_in_a_closed_folder_is_copied_when_it_is_opened(
    daemon: Served, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The list of recordings copies nothing; a view copies once, and reads the copy then."""
    monkeypatch.setattr("os.access", lambda *_: False)
    cache = RecordingCache(tmp_path / "cache")
    worker = RecordingWorker(cache)
    copy = cache.path(daemon.socket.parent.name, NAME)

    assert "copied before" in worker.answer(wanted(daemon, "contents"))["error"]["what"]
    assert not copy.exists()
    column = worker.answer(wanted(daemon, "view", column="axis_x/position_um"))["result"]
    assert max(column["maximum"]) == SPIKE_UM
    assert copy.read_bytes() == recording.read_bytes()
    contents = RecordingWorker(cache).answer(wanted(daemon, "contents"))
    assert contents["result"]["rows"] == 2000


def test_the_oldest_copies_make_room(tmp_path: Path) -> None:
    """Copies are within their total size, and the newest stays."""
    cache = RecordingCache(tmp_path, most_bytes=250)
    paths = [cache.path("bench", name) for name in "abc"]
    for path in paths:
        cache.add(path, lambda file: file.write_bytes(bytes(100)))
    assert [path.exists() for path in paths] == [False, True, True]
