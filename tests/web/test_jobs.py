"""Identification and learning for the page: their commands, and how a tab sees them."""

import math
from pathlib import Path

import httpx
import pytest

from piezod.config.fields import Context
from piezod.config.play import WaveConfig
from piezod.config.scan import load_scan
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml
from piezod.experiment.live.drive import read_drive
from piezod.web.job_commands import (
    ChosenDrive,
    FileChoices,
    IdentifyJob,
    LearnJob,
    ReplayJob,
    ScanJob,
    command_of,
    identify_command,
    kept_folder,
    learn_command,
    replay_command,
    scan_command,
    tables_folder,
)
from tests.web.browser import Tab, Web

DRIVE = {"low_v": 5.0, "high_v": 90.0, "duration_s": 10.0}


def test_a_chosen_drive_is_one_that_the_command_takes(tmp_path: Path) -> None:
    """It starts at the lowest voltage, has the largest swing twice, and stays in the range."""
    wanted = IdentifyJob(id=1, do="identify", stage="bench", axis="x", drive=ChosenDrive(**DRIVE))
    arguments = identify_command(wanted, tmp_path)
    drive = read_drive(Path(arguments[arguments.index("--drive") + 1]))
    voltage = drive.drive_v.built(drive.duration_s)
    values_v = [voltage.value(step / 1000) for step in range(int(1000 * drive.duration_s))]

    assert values_v[0] == pytest.approx(5.0)
    assert min(values_v) >= 5.0 - 1e-9
    after = values_v[math.ceil(1000 * drive.run_in_s) :]
    assert max(values_v) == pytest.approx(90.0, abs=0.1)
    assert max(after) == pytest.approx(90.0, abs=0.1)
    assert arguments[:5] == ["identify", "--live", "--axis", "x", "--method"]


def test_without_a_drive_the_command_designs_its_own(tmp_path: Path) -> None:
    """The complete drive needs no file."""
    wanted = IdentifyJob(id=1, do="identify", stage="bench", axis="x")
    assert "--drive" not in identify_command(wanted, tmp_path)


def test_a_waveform_is_one_that_the_command_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tables of a stage have a folder of their own, which lasts."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    sine = {"kind": "sine", "low": 8.0, "high": 16.0, "frequency_hz": 50.0}
    arguments = learn_command(
        LearnJob(id=1, do="learn", stage="bench", axis="x", command_um=sine), tmp_path
    )
    document = load_yaml(Path(arguments[1]))
    document.data.setdefault("name", "wave")
    wave = validate(document, WaveConfig, Context(tmp_path))

    assert wave.period_s == pytest.approx(0.02)
    assert tables_folder("bench").is_dir()
    assert tables_folder("bench") != tables_folder("other")
    assert arguments[arguments.index("--tables") + 1] == str(tables_folder("bench"))


def test_a_scan_is_one_that_the_command_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its file lasts beyond the job."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    span = {"from_um": 5, "to_um": 15, "pixels": 64}
    scan = {
        "kind": "raster",
        "fast": {"axis": "x", **span},
        "slow": {"axis": "y", **span},
        "lines_per_s": 5,
        "pulses": {},
    }
    wanted = ScanJob(id=1, do="scan", stage="bench", axis="x", scan=scan)
    arguments = scan_command(wanted, tmp_path)

    assert load_scan(Path(arguments[1])).spans[1].axis == "y"
    assert Path(arguments[-1]).parent == kept_folder("scans", "bench")
    assert kept_folder("scans", "bench").is_dir()


def test_a_replay_uses_the_present_model(tmp_path: Path) -> None:
    """The command gets the model as a file; without one it uses that of the recording."""
    wanted = ReplayJob(id=1, do="replay", stage="bench", axis="x", recording="20240501T120000Z")
    arguments = replay_command(wanted, {"method": "lms"}, tmp_path)
    model = tmp_path / arguments[arguments.index("--model") + 1]

    assert load_yaml(model).data == {"method": "lms"}
    assert arguments[:2] == ["replay", "20240501T120000Z"]
    assert "--model" not in replay_command(wanted, None, tmp_path)


def test_tables_of_the_service_are_in_its_folder() -> None:
    """The user of the service has no home folder."""
    environ = {"STATE_DIRECTORY": "/var/lib/piezod-web", "XDG_STATE_HOME": "/home/olga/state"}

    assert tables_folder("bench", environ) == Path("/var/lib/piezod-web/tables/bench")


def last_job(tab: Tab) -> dict[str, object]:
    """Return the job after its end."""
    while (job := tab.event("job")["job"])["running"]:
        pass
    ended: dict[str, object] = job
    return ended


def test_a_refusal_reaches_the_tab_in_words(web: Web) -> None:
    """A command that fails has its text as error, and every tab can read it afterwards."""
    with web.tab() as tab:
        started = tab.ask(do="identify", stage="bench", axis="none")
        busy = tab.ask(do="learn", stage="bench", axis="x", command_um={})
        job = last_job(tab)
    with web.tab() as other:
        seen = other.ask(do="job", stage="bench")["result"]["job"]

    assert started["result"]["running"]
    assert busy["error"]["code"] == "busy"
    assert job["error"]
    assert "Traceback" not in str(job["error"])
    assert seen == job


def test_a_job_is_ended_from_another_tab(web: Web) -> None:
    """The command is interrupted, also before it has done anything."""
    with web.tab() as tab, web.tab() as other:
        tab.ask(do="identify", stage="bench", axis="x")
        other.ask(do="end_job", stage="bench")
        assert last_job(tab)["error"] == "ended as requested"


def test_without_a_job_there_is_nothing_to_see(web: Web) -> None:
    """A stage that nobody identified has no figure."""
    assert web.request("GET", "/jobs/none.png", Cookie=web.cookie()).status_code == 404


@pytest.mark.parametrize(
    "change",
    [{"method": "best"}, {"axis": "--out"}, {"drive": {**DRIVE, "duration_s": 1e9}}, {"more": 1}],
)
def test_what_a_command_would_not_take_is_refused(web: Web, change: dict[str, object]) -> None:
    """An option that is none, or out of range, starts nothing."""
    with web.tab() as tab:
        message = {"do": "identify", "stage": "bench", "axis": "x", **change}
        tab.send(**message)
        answer = tab.answer(None)
    assert answer["error"]["code"] == "invalid"


RECORD = "TIME,CH1,CH2\ns,V,V\n" + "".join(
    f"{k / 100},{50 + k % 40},{(k % 40) / 8}\n" for k in range(400)
)


def send(web: Web, name: str, text: str, **headers: str) -> httpx.Response:
    """Send a file as the page does."""
    headers = {"Cookie": web.cookie(), "Origin": f"http://{web.host}"} | headers
    url = f"http://{web.host}/uploads/{name}"
    return httpx.post(url, content=text.encode(), headers={"x-file-name": "a%20b.csv", **headers})


def test_a_sent_file_is_shown_as_it_is_read(web: Web) -> None:
    """What cannot be told is an error with the command; with the columns there is a picture."""
    with web.tab() as tab:
        asked = {"do": "import", "stage": "bench", "axis": "x"}
        none_yet = tab.ask(**asked, file={})
        assert send(web, "bench", RECORD).status_code == 200
        tab.ask(**asked, file={})
        unclear = last_job(tab)
        tab.ask(**asked, file={"columns": "drive=CH1,position=CH2", "scale": "position=2"})
        job = last_job(tab)

    assert none_yet["error"]["what"] == "no file was sent for stage bench"
    assert "a_b.csv: which column is the drive voltage?" in str(unclear["error"])
    assert "--columns t=TIME,drive=CH1,position=CH2" in str(unclear["error"])
    assert job["error"] == ""
    assert job["figure"]
    assert "position_um = 2 · 'CH2', which is in V." in str(job["result"])


def test_a_sent_file_can_be_fitted(tmp_path: Path) -> None:
    """The command reads the file and drives nothing; no choice is an option of its own."""
    upload = tmp_path / "a.csv"
    upload.write_text(RECORD)
    folder = tmp_path / "job"
    folder.mkdir()
    choices = FileChoices(columns="t=TIME", offset="-1", rate_hz=100.0)
    wanted = IdentifyJob(id=1, do="identify", stage="bench", axis="x", file=choices)
    arguments = command_of(wanted, None, upload)(folder)

    assert arguments[:4] == ["identify", "a.csv", "--method", "auto"]
    assert arguments[-3:] == ["--columns=t=TIME", "--offset=-1", "--rate-hz=100.0"]
    assert "--live" not in arguments
    assert (folder / "a.csv").read_text() == RECORD


@pytest.mark.parametrize(
    ("name", "headers", "status"),
    [
        ("none", {}, 400),
        ("bench", {"Origin": "http://elsewhere.org"}, 403),
        ("bench", {"Cookie": "piezod=none"}, 401),
    ],
)
def test_a_file_from_elsewhere_is_refused(
    web: Web, name: str, headers: dict[str, str], status: int
) -> None:
    """It needs the cookie, the page's own origin, and a stage."""
    with web.tab():
        assert send(web, name, RECORD, **headers).status_code == status


def test_a_file_needs_an_origin_and_has_a_largest_size(
    web: Web, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A form of another page sends none; too many bytes are refused as they arrive."""
    url = f"http://{web.host}/uploads/bench"
    with web.tab():
        assert httpx.post(url, headers={"Cookie": web.cookie()}).status_code == 403
        monkeypatch.setattr("piezod.web.uploads.MOST_UPLOAD", 1000)
        answer = send(web, "bench", RECORD)

    assert answer.status_code == 400
    assert answer.json()["error"]["code"] == "too_large"
