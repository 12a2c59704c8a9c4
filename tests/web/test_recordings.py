"""What the page gets of recordings, and how they are read."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from piezod.records.recording.writer import TelemetryWriter
from piezod.telemetry.arrays import record_dtype
from piezod.web.recording_cache import RecordingCache
from piezod.web.recording_worker import RecordingWorker
from tests.daemon.service.fakes import Served
from tests.records.telemetry import START_NS, header
from tests.web.browser import Tab, Web
from tests.web.test_jobs import last_job

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
    """Contents, a column with its spike, marks and the loop arrive over the WebSocket.

    An unknown column is refused, as is a path in place of a name, and the process that reads
    answers the next request.
    """
    assert recording.is_file()
    of = {"stage": "bench", "recording": NAME}
    with web.tab() as tab:
        contents = tab.ask(do="contents", **of)["result"]
        column = tab.ask(do="view", column="axis_x/position_um", points=50, **of)["result"]
        refused = tab.ask(do="view", column="axis_x/none", **of)
        outside = tab.ask(do="contents", stage="bench", recording="../../etc/passwd")
        marks = tab.ask(do="marks", axis="x", **of)["result"]
        loop = tab.ask(do="loop", axis="x", begin_s=1, end_s=1.1, **of)["result"]

    assert (contents["rows"], contents["axes"]) == (2000, ["x"])
    assert max(column["maximum"]) == SPIKE_UM
    assert len(column["begin_s"]) <= 50
    assert (refused["ok"], refused["error"]["code"]) == (False, "recording")
    assert "no column 'axis_x/none'" in refused["error"]["what"]
    assert (outside["ok"], outside["error"]["code"]) == (False, "recording")
    assert "no recording" in outside["error"]["what"]
    assert marks == []
    assert loop["drive_v"] == [row / 20 for row in range(1000, 1100)]


@pytest.mark.usefixtures("recording")
@pytest.mark.parametrize("name", ["20240501T120000Z-none", "../../etc/passwd", ""])
def test_an_unknown_recording_is_refused(daemon: Served, tmp_path: Path, name: str) -> None:
    """Only names in the list of the daemon are read, so none leads out of its folder."""
    worker = RecordingWorker(RecordingCache(tmp_path / "cache"))
    refused = worker.answer(wanted(daemon, "contents", recording=name))["error"]

    assert refused["code"] == "recording"
    assert "no recording" in refused["what"]


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


@pytest.mark.usefixtures("recording")
def test_a_recording_is_exported_as_a_table(web: Web) -> None:
    """The table is that of `piezod export`, and a download; the token is needed as for the file."""
    path = f"/recordings/bench/{NAME}/csv"
    file = web.request("GET", path, Cookie=web.cookie())
    head, *rows = file.text.splitlines()

    assert web.request("GET", path).status_code == 401
    assert file.headers["content-disposition"] == f'attachment; filename="{NAME}.csv"'
    assert file.headers["content-type"].startswith("text/csv")
    assert len(rows) == 2000
    position = head.split(",").index("position_um")
    assert max(float(row.split(",")[position]) for row in rows) == SPIKE_UM


@pytest.mark.usefixtures("recording")
def test_an_export_ends_when_the_browser_leaves(
    web: Web, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One table is made at a time; one that nobody waits for holds up no other."""
    endless = tmp_path / "endless"
    endless.write_text("#!/bin/sh\nexec sleep 1000\n")
    endless.chmod(0o755)
    path, cookie = f"/recordings/bench/{NAME}/csv", web.cookie()
    monkeypatch.setattr("sys.executable", str(endless))
    with pytest.raises(httpx.ReadTimeout):
        httpx.get(f"http://{web.host}{path}", headers={"Cookie": cookie}, timeout=0.5)
    endless.write_text("#!/bin/sh\necho made >&2\nexit 1\n")
    failed = web.request("GET", path, Cookie=cookie)

    assert failed.status_code == 503
    assert failed.json()["error"]["what"] == "made"


@pytest.mark.usefixtures("recording")
def test_parquet_needs_its_library(web: Web) -> None:
    """Where pyarrow is missing, the answer says how to install it."""
    file = web.request("GET", f"/recordings/bench/{NAME}/parquet", Cookie=web.cookie())

    if find_spec("pyarrow"):
        assert file.content.startswith(b"PAR1")
    else:
        assert file.status_code == 503
        assert "pip install 'piezod[parquet]'" in file.json()["error"]["what"]


@pytest.mark.parametrize("installed", [True, False])
def test_page_knows_which_tables_can_be_made(
    web: Web, installed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It bars the other ones with this reason."""
    monkeypatch.setattr("piezod.web.export.find_spec", lambda _: "found" if installed else None)
    with web.tab() as tab:
        tables = tab.ask(do="stages")["result"]["tables"]

    assert tables["csv"] == ""
    assert ("pip install" in tables["parquet"]) != installed


@pytest.mark.usefixtures("recording")
@pytest.mark.parametrize("path", ["none/csv", "none"])
def test_a_person_reads_why_there_is_no_file(web: Web, path: str) -> None:
    """A tab of a browser shows words; a program gets the document of the error."""
    url, cookie = f"/recordings/bench/20240501T120000Z-{path}", web.cookie()
    shown = web.request("GET", url, Cookie=cookie, Accept="text/html,application/xhtml+xml")
    document = web.request("GET", url, Cookie=cookie)

    assert shown.status_code == document.status_code >= 400
    assert shown.headers["content-type"].startswith("text/plain")
    assert shown.text.startswith(document.json()["error"]["what"])


@pytest.mark.parametrize(
    ("path", "status"),
    [("bench/20240501T120000Z-none/csv", 503), (f"bench/{NAME}/xlsx", 404),
     (f"other/{NAME}/csv", 404), ("bench/--help/csv", 404), ("bench/../csv", 404)],
)  # fmt: skip
def test_what_cannot_be_exported_is_refused(
    web: Web, recording: Path, path: str, status: int
) -> None:
    """Only recordings of a stage that runs are exported, and only as the two formats."""
    assert recording.is_file()
    assert web.request("GET", f"/recordings/{path}", Cookie=web.cookie()).status_code == status


def test_a_replay_is_a_job(
    web: Web, daemon: Served, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the command says about a recording that it cannot replay is the error of the job."""

    async def params() -> dict[str, Any]:
        return {"axes": {"x": {"model": None}}}

    monkeypatch.setattr(daemon.stage, "params", params)
    wanted = {"do": "replay", "stage": "bench", "recording": recording.stem}
    with web.tab() as tab:
        unknown = tab.ask(**wanted, axis="y")
        tab.send(**{**wanted, "axis": "x", "recording": "../a"})
        invalid = tab.answer(None)
        started = tab.ask(**wanted, axis="x")
        job = last_job(tab)

    assert unknown["error"]["remedy"] == "axes: x"
    assert invalid["error"]["code"] == "invalid"
    assert started["result"]["kind"] == "replay"
    assert "the file has no configuration of the stage" in str(job["error"])


def test_a_viewer_replays_nothing(web: Web, recording: Path) -> None:
    """A replay takes a processor of the stage's machine: it needs the role of an operator."""
    answer = web.request("GET", f"/?token={web.access.tokens.viewer}")
    cookie = answer.headers["set-cookie"].partition(";")[0]
    with web.socket(cookie=cookie) as connection:
        refused = Tab(connection).ask(
            do="replay", stage="bench", axis="x", recording=recording.stem
        )
    assert refused["error"]["code"] == "forbidden"
