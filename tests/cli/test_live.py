"""`piezod experiment --live` and `piezod identify --live` on a daemon, in real time."""

import json
import os
import re
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.client import StageClient
from piezod.config.model_file import load_model
from piezod.experiment.live.identify import LiveRecord
from piezod.reading.record import read_record
from piezod.records.experiment_file import read_hdf5
from tests.cli.conftest import Command, Outcome
from tests.control.rig_stage import shipped_config
from tests.daemon.daemons import SHIPPED, Daemon, configuration
from tests.daemon.waiting import eventually
from tests.experiment.conftest import SHORT
from tests.experiment.made_up import record_of, write_record
from tests.experiment.play.test_run import SHORT as SHORT_PLAY
from tests.forked import Forked

RATE_HZ = 30.0
LIVE = SHORT.replace("period_s: 1\n    duration_s: 3", "period_s: 0.5\n    duration_s: 1")
LIVE = LIVE.replace("settle_s: 0.5\ncases", "settle_s: 0.1\ncases")
DRIVE = """\
identification:
  method: least-squares
  settle_s: 0.1
  duration_s: 4
  drive_v:
    kind: sine
    low: 0
    high: 140
    frequency_hz: 1
    envelope: {kind: decaying, time_constant_s: 4}
"""
PLAY = (
    SHORT_PLAY.replace("passes: 3", "passes: 1\n  highest_hz: 1000\n  amplitude_pct: 1")
    .replace("low: 4, high: 24, frequency_hz: 200", "low: 8, high: 16, frequency_hz: 50")
    .replace("sine 200 Hz", "sine 50 Hz")
)
"""What is not too fast for the rig."""
MODEL = SHIPPED.parent / "models" / "simulated-stack.yaml"
INTERRUPTED = 130
ATTEMPTS = 3
LATE = re.compile(r"\bL[257]\b|the loop (skipped cycles|did not take the request)")
"""Texts of the command or of the daemon's log if the machine was too busy for the loop."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """Return a daemon of a simulated stage, at a rate that a busy machine can mostly keep."""
    folder = tmp_path_factory.mktemp("rig")
    safety = "{safe_v: 0, ramp_v_per_s: 500}"
    with Daemon(configuration(folder, rate_hz=f"{RATE_HZ:g}", safety=safety)) as daemon:
        yield daemon.up()


@pytest.fixture
def socket(rig: Daemon) -> tuple[str, str]:
    """Return the option that names the stage, which is disarmed, and which nobody holds."""
    rig.until("SAFE")
    # The session of a command that was interrupted ends a moment after the command.
    eventually(lambda: rig.ask("POST", "lease", {}).status_code == 200)
    rig.ask("DELETE", "lease")
    return "--socket", str(rig.paths.api_socket)


@pytest.fixture
def first_model(rig: Daemon) -> None:
    """Start the daemon again if another test has replaced the model of its configuration."""
    axes = eventually(lambda: rig.ask("GET", "params").json().get("axes"))
    if axes["x"]["model"]["source"]["sha256"] != load_model(MODEL).source.sha256:
        as_new(rig)


@pytest.fixture
def known_afterwards(rig: Daemon) -> Iterator[None]:
    """Start the daemon again after a play, which makes the hysteresis memory unknown."""
    yield
    as_new(rig)


@pytest.fixture
def live_file(folder: Path) -> Path:
    """Return an experiment with a case of one second."""
    (folder / "live.yaml").write_text(LIVE, encoding="utf-8")
    return folder / "live.yaml"


@pytest.fixture
def made_up_record(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the record by a made-up one, without driving the stage."""

    def record_live(_client: StageClient, file: Path, *_: object, **__: object) -> LiveRecord:
        write_record(file, record_of())
        return LiveRecord("x", file, 0.0, (), shipped_config().axes["x"])

    monkeypatch.setattr("piezod.cli.identify.run.record_live", record_live)


def as_new(rig: Daemon) -> None:
    """Start the daemon again, without faults and with a known hysteresis memory."""
    eventually(lambda: rig.status().get("state") in {"SAFE", "FAULT"})
    rig.do("shutdown")
    rig.exit_code()
    rig.start()
    rig.up()


def punctual(rig: Daemon, attempt: Callable[[], Outcome]) -> Outcome:
    """Return the outcome of a command, repeated if the loop was late."""
    for _ in range(ATTEMPTS - 1):
        logged = len(rig.text)
        outcome = attempt()
        failed = outcome.code not in {0, INTERRUPTED}
        if not failed or not LATE.search(outcome.err + rig.text[logged:]):
            return outcome
        as_new(rig)
    return attempt()


def ended_in(rig: Daemon, state: str, number: signal.Signals, *arguments: str) -> Outcome:
    """Run a command as a process, and send it a signal once the stage is in a state."""
    with Path(os.devnull).open("r+b") as nothing, tempfile.TemporaryFile("w+") as err:
        streams = nothing.fileno(), nothing.fileno(), err.fileno()
        process = Forked(arguments, streams)
        eventually(lambda: rig.status().get("state") == state or process.poll() is not None, 60.0)
        process.send_signal(number)
        code = process.wait()
        err.seek(0)
        return Outcome(code, "", err.read())


@pytest.mark.usefixtures("blank_figures", "first_model")
def test_experiment(
    piezod: Command, rig: Daemon, socket: tuple[str, str], live_file: Path, folder: Path
) -> None:
    """A live experiment writes the usual files, with rate and model of the stage, and disarms."""
    command = ("experiment", live_file, "--live", "--out", "o", "--json", *socket)

    code, out, err = punctual(rig, lambda: piezod(*command))

    assert (err, code) == ("", 0)
    document = json.loads(out)
    rows = {row["mode"]: row for row in document["cases"]}
    assert list(rows) == ["uncompensated", "feedforward", "adaptive"]
    assert rows["feedforward"]["tracking_rms_pct"] < 0.5 * rows["uncompensated"]["tracking_rms_pct"]
    assert document["title"] == "live (live on stage rig)"
    assert document["model"]["axes"]["x"]["source"] == "model in use on stage rig"
    assert any("were not used" in each for each in document["warnings"])
    assert any(f"stage rig runs at {RATE_HZ:g} Hz" in each for each in document["warnings"])
    result = read_hdf5(folder / "o" / "experiment.h5")
    for recording in result.recordings:
        assert np.ptp(recording.t_s) == pytest.approx(1.0, abs=0.25)
        assert recording.command_um.max() == pytest.approx(20.0, abs=1.0)
        assert recording.weights.shape[1] == 38
    assert result.rate_hz == RATE_HZ
    assert (folder / "o" / "report.html").is_file()
    assert rig.status()["state"] == "SAFE"
    names = [each["name"] for each in rig.ask("GET", "recordings").json()["recordings"]]
    assert any(name.endswith("slow-adaptive") for name in names)


@pytest.mark.usefixtures("first_model")
def test_scan_by_the_loop(
    piezod: Command, rig: Daemon, socket: tuple[str, str], folder: Path
) -> None:
    """The loop sweeps a line; the file has the position and the lateness of each pixel."""
    fast = "{axis: x, from_um: 6, to_um: 14, pixels: 5}"
    scan = f"{{kind: line, mode: adaptive, fast: {fast}, repeats: 4, lines_per_s: 2}}"
    (folder / "scan.yaml").write_text(f"scan: {scan}")
    command = ("scan", "scan.yaml", "--live", "--json", *socket)

    code, out, err = punctual(rig, lambda: piezod(*command))

    assert code == 0, err
    with h5py.File(folder / json.loads(out)["file"]) as file:
        pixels = file["scan/pixels"]
        position_um = pixels["position_x_um"][()].reshape(4, 5)
        assert len(pixels["late_ns"]) == 20
    centres_um = 6.8 + 1.6 * np.arange(5)
    assert position_um[2] == pytest.approx(centres_um, abs=1.0)
    assert position_um[3] == pytest.approx(centres_um[::-1], abs=1.0)
    assert rig.status()["state"] == "SAFE"


def test_experiment_that_does_not_fit_moves_nothing(
    piezod: Command, socket: tuple[str, str], live_file: Path
) -> None:
    """The range of the stage applies, and not that of the file."""
    live_file.write_text(LIVE.replace("high: 20", "high: 27"), encoding="utf-8")

    code, out, err = piezod("experiment", live_file, "--live", *socket)

    assert (code, out) == (1, "")
    assert "slow commands 0 to 27 µm, but axis x may be commanded from 0 to 2" in err


@pytest.mark.stress
@pytest.mark.usefixtures("first_model", "known_afterwards")
def test_experiment_with_play(
    piezod: Command, rig: Daemon, socket: tuple[str, str], live_file: Path, folder: Path
) -> None:
    """A live experiment with `play` learns on the stage, writes the usual files, and disarms."""
    live_file.write_text(PLAY, encoding="utf-8")
    command = ("experiment", live_file, "--live", "--out", "o", "--json", *socket)

    code, out, err = punctual(rig, lambda: piezod(*command))

    assert (err, code) == ("", 0)
    document = json.loads(out)
    (wave,) = document["axes"]["x"]["waves"]
    inverse, response, learned = (play["measured"]["max_pct"] for play in wave["plays"])
    assert inverse > response > 2.0 * learned
    assert document["title"] == "short (live on stage rig)"
    files = sorted(path.name for path in (folder / "o").iterdir())
    assert files == ["play_x_01.png", "table_x_01.yaml"]
    assert rig.status()["state"] == "SAFE"


def interrupted(rig: Daemon, socket: tuple[str, str], file: Path, state: str) -> Outcome:
    """Return the outcome of a live experiment that gets Ctrl-C in a state of the stage."""
    what = ("experiment", str(file), "--live", *socket)
    return punctual(rig, lambda: ended_in(rig, state, signal.SIGINT, *what))


@pytest.mark.usefixtures("first_model")
def test_interrupt_stops_the_stage(rig: Daemon, socket: tuple[str, str], live_file: Path) -> None:
    """Ctrl-C during a run ramps to the safe voltage and ends the recording."""
    live_file.write_text(LIVE.replace("duration_s: 1\n", "duration_s: 20\n"), encoding="utf-8")

    code, _, err = interrupted(rig, socket, live_file, "RUN")

    assert (code, err) == (INTERRUPTED, "interrupted\n")
    rig.until("SAFE")
    assert rig.ask("GET", "recordings").json()["running"] is None


@pytest.mark.usefixtures("first_model", "known_afterwards")
def test_interrupt_aborts_a_play(rig: Daemon, socket: tuple[str, str], live_file: Path) -> None:
    """Ctrl-C while the device plays a table ramps to the safe voltage."""
    live_file.write_text(PLAY, encoding="utf-8")

    code, _, err = interrupted(rig, socket, live_file, "IDENT")

    assert (code, err) == (INTERRUPTED, "interrupted\n")
    rig.until("SAFE")


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.stress)]
)
def test_killed_identification_leaves_nothing_driven(
    rig: Daemon, socket: tuple[str, str], folder: Path, number: signal.Signals
) -> None:
    """The daemon stops the stage and ends the recording of a command that is killed."""
    (folder / "drive.yaml").write_text(DRIVE.replace("duration_s: 4", "duration_s: 60"))
    what = ("identify", "--live", "--drive", "drive.yaml", *socket)

    def killed() -> Outcome:
        ended = ended_in(rig, "IDENT", number, *what)
        return ended._replace(code=0) if ended.code == -number else ended

    code, _, err = punctual(rig, killed)

    assert code in {0, INTERRUPTED}, err
    rig.until("SAFE")
    eventually(lambda: rig.ask("GET", "recordings").json()["running"] is None)
    assert "session ended: stop" in [
        each["what"] for each in rig.ask("GET", "audit").json()["audit"]
    ]


def test_identify_and_adopt(
    piezod: Command, rig: Daemon, socket: tuple[str, str], folder: Path
) -> None:
    """The stage is driven, the record is stored, and the new model is in use at once."""
    (folder / "drive.yaml").write_text(DRIVE, encoding="utf-8")
    options = ("--drive", "drive.yaml", "--out", "m.yaml", "--adopt", "--order", 5, "--json")

    code, out, err = punctual(rig, lambda: piezod("identify", "--live", *options, *socket))

    assert (err, code) == ("", 0)
    document = json.loads(out)
    assert (document["axis"], document["adopted"], document["data"]) == ("x", True, "m.csv")
    assert document["train"]["voltage_error_max_pct"] < 5.0
    columns = read_record(folder / "m.csv").columns
    assert np.ptp(columns["t_s"]) == pytest.approx(4.0, abs=0.25)
    assert columns["drive_v"].max() == pytest.approx(123.5, abs=6.0)
    written = load_model(folder / "m.yaml")
    used = rig.ask("GET", "params").json()["axes"]["x"]["model"]
    assert used["right_stop_thresholds"] == list(written.right_stop_thresholds)
    assert used["source"]["sha256"] == written.source.sha256
    assert rig.status()["state"] == "SAFE"


@pytest.mark.usefixtures("made_up_record")
def test_identify_says_how_to_keep_the_model(
    piezod: Command, socket: tuple[str, str], folder: Path
) -> None:
    """The text is that of a file, followed by the next commands."""
    code, out, err = piezod("identify", "--live", "--adopt", "--order", 5, *socket)

    assert (err, code) == ("", 0)
    assert out.startswith("Usable: yes.")
    assert "`piezod params save` keeps it for the next start." in " ".join(out.split())
    assert "`piezod condition`" in " ".join(out.split())
    assert (folder / "rig-record.csv").is_file()


@pytest.mark.stress
@pytest.mark.usefixtures("made_up_record")
def test_a_surface_is_adopted(
    piezod: Command, rig: Daemon, socket: tuple[str, str], folder: Path
) -> None:
    """A running stage uses a surface from now on; the model file beside the record has it."""
    options = ("--method", "surface", "--out", "m.yaml", "--adopt", "--json")

    code, out, err = piezod("identify", "--live", *options, *socket)

    assert (err, code) == ("", 0)
    assert json.loads(out)["method"] == "surface"
    used = rig.ask("GET", "params").json()["axes"]["x"]["model"]
    assert used["surface_coefficients"] == list(load_model(folder / "m.yaml").surface_coefficients)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (
            ("experiment", "live.yaml", "--stage", "x"),
            "--stage, --socket and --largest-step-pct need --live",
        ),
        (("experiment", "live.yaml", "--live", "--seed", 1), "a running stage has its own seed"),
        (("identify",), "Missing argument 'DATA'; or --live"),
        (("identify", "live.yaml", "--live"), "DATA and --live exclude each other"),
        (("identify", "live.yaml", "--adopt"), "--adopt, --stage and --socket need --live"),
        (("identify", "--live", "--out", "model.txt"), "must end in .yaml"),
    ],
)
@pytest.mark.usefixtures("live_file")
def test_wrong_usage(piezod: Command, arguments: tuple[object, ...], text: str) -> None:
    """Options that need a running stage, or exclude one, are refused otherwise."""
    code, out, err = piezod(*arguments)

    assert (code, out) == (2, "")
    assert text in " ".join(err.replace("│", " ").split())


def test_no_stage_runs(piezod: Command, live_file: Path, folder: Path) -> None:
    """Without a daemon the exit code is 69, as for every verb."""
    code, _, err = piezod("experiment", live_file, "--live", "--socket", folder / "no.sock")

    assert code == 69
    assert "no.sock" in err
