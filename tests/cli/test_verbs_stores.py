"""`piezod params` and `piezod record`."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Command
from tests.client.fake_daemon import FakeDaemon, Raw
from tests.records.killed import killed

NAME = "20261121T120000Z"
HISTORY = {
    "history": [
        {"sequence": 4, "saved_at": "2026-11-21T12:00:00+00:00", "saved_by": "eva", "axes": ["x"]},
        {"sequence": 3, "why": "the checksum is wrong"},
    ]
}


@pytest.mark.parametrize(
    ("arguments", "what", "text"),
    [
        ("save", "POST params/save", "saved as 4\n"),
        ("load", "POST params/load", "loaded 4\n"),
        ("restore 4", "POST params/restore", "restored 4\n"),
    ],
)
def test_params(piezod: Command, daemon: FakeDaemon, arguments: str, what: str, text: str) -> None:
    """Each verb prints the number of the parameters."""
    daemon.answers[what] = {"sequence": 4}

    assert piezod("params", *arguments.split()) == (0, text, "")
    assert daemon.asked[0].what == what
    _, out, _ = piezod("params", *arguments.split(), "--json")
    assert json.loads(out) == {"sequence": 4}


def test_params_in_use(piezod: Command, daemon: FakeDaemon) -> None:
    """The parameters of an axis are listed, except the weights of its model."""
    axis = {"zero_um": 1.5, "offset": None, "model": {"method": "lms", "right_stop_weights": [1.0]}}
    daemon.answers["GET params"] = {"sequence": 4, "axes": {"x": axis}}

    code, out, _ = piezod("params", "list")

    assert (code, out) == (0, "axis x\n  zero_um: 1.5\n  offset: –\n  model: lms\nsaved as 4\n")
    _, out, _ = piezod("params", "list", "--json")
    assert json.loads(out)["axes"]["x"] == axis


def test_params_never_saved(piezod: Command, daemon: FakeDaemon) -> None:
    """Parameters that were never saved are shown as not saved."""
    daemon.answers["GET params"] = {"sequence": None, "axes": {}}

    assert piezod("params", "list") == (0, "not saved\n", "")


def test_history(piezod: Command, daemon: FakeDaemon) -> None:
    """The history is newest first, with the reason if parameters cannot be used."""
    daemon.answers["GET params/history"] = HISTORY
    _, out, _ = piezod("params", "history")
    assert out.index("eva") < out.index("the checksum is wrong")
    _, out, _ = piezod("params", "history", "--json")
    assert json.loads(out) == HISTORY

    daemon.answers["GET params/history"] = {"history": []}
    assert piezod("params", "history") == (0, "nothing is saved\n", "")


def test_recording(piezod: Command, daemon: FakeDaemon) -> None:
    """A recording starts with a label; its end prints the number of cycles."""
    daemon.answers["POST recordings/start"] = {"name": f"{NAME}-creep"}
    daemon.answers["POST recordings/stop"] = {"name": f"{NAME}-creep", "records": 5, "lost": 0}

    assert piezod("record", "start", "creep") == (0, f"recording {NAME}-creep\n", "")
    assert piezod("record", "stop") == (0, f"recorded 5 cycles as {NAME}-creep\n", "")
    assert daemon.asked[0].body == {"label": "creep"}


def test_recording_with_losses(piezod: Command, daemon: FakeDaemon) -> None:
    """Lost cycles are printed, and the reason of an end by itself."""
    answer = {"name": NAME, "records": 5, "lost": 2, "why": "the disk is full"}
    daemon.answers["POST recordings/stop"] = answer

    assert piezod("record", "stop").out == (
        f"recorded 5 cycles as {NAME}; 2 were lost; the disk is full\n"
    )
    assert json.loads(piezod("record", "stop", "--json").out) == answer


def test_recordings(piezod: Command, daemon: FakeDaemon) -> None:
    """The finished recordings are listed, and the one in progress."""
    running = {"name": NAME, "records": 7, "lost": 0}
    finished = [{"name": f"{NAME}-creep", "size_bytes": 2_500_000}]
    daemon.answers["GET recordings"] = {"running": running, "recordings": finished}
    _, out, _ = piezod("record", "list")
    assert out == f"{NAME}-creep  2.5 MB\n{NAME}  7 cycles, in progress\n"
    daemon.answers["GET recordings"] = {"running": None, "recordings": finished}
    assert piezod("record", "list").out == f"{NAME}-creep  2.5 MB\n"
    _, out, _ = piezod("record", "list", "--json")
    assert json.loads(out) == {"running": None, "recordings": finished}

    daemon.answers["GET recordings"] = {"running": None, "recordings": []}
    assert piezod("record", "list") == (0, "nothing is recorded\n", "")


def test_recording_is_copied(piezod: Command, daemon: FakeDaemon, folder: Path) -> None:
    """A recording is copied to its own name in the current folder, or to a given file."""
    daemon.answers[f"GET recordings/{NAME}"] = Raw(200, b"HDF")

    assert piezod("record", "get", NAME) == (0, f"{NAME}.h5: 3 bytes\n", "")
    assert (folder / f"{NAME}.h5").read_bytes() == b"HDF"
    _, out, _ = piezod("record", "get", NAME, "--out", "a.h5", "--json")
    assert json.loads(out) == {"name": NAME, "file": "a.h5", "size_bytes": 3}
    assert (folder / "a.h5").read_bytes() == b"HDF"


def test_recording_to_a_missing_folder(piezod: Command, daemon: FakeDaemon) -> None:
    """A missing folder is an error with its name."""
    daemon.answers[f"GET recordings/{NAME}"] = Raw(200, b"HDF")

    code, _, err = piezod("record", "get", NAME, "--out", "no/a.h5")

    assert code == 1
    assert "no/.a.h5.part: No such file" in err


def test_help_says_what_is_not_restored(piezod: Command) -> None:
    """Help says that offset and scale are not restored."""
    _, out, _ = piezod("params", "--help")

    assert "saved and not restored" in out


def test_label_is_checked_before_it_is_sent(piezod: Command, daemon: FakeDaemon) -> None:
    """A label with a space is refused with the allowed characters, and nothing is asked."""
    code, _, err = piezod("record", "start", "my scan")

    assert code == 2
    assert "up to 32 letters, digits, _ and -" in " ".join(err.split())
    assert daemon.asked == []


def test_record_repair_needs_no_daemon(piezod: Command, tmp_path: Path) -> None:
    """A recording of a killed daemon is repaired, once; a file of another kind is an error."""
    file, text = tmp_path / "killed.h5", tmp_path / "text.h5"
    killed(file, 50)
    text.write_text("text", encoding="utf-8")

    assert piezod("record", "repair", str(file)) == (0, f"{file}: repaired\n", "")
    assert piezod("record", "repair", str(file)) == (0, f"{file}: nothing to repair\n", "")
    code, out, err = piezod("record", "repair", str(text))
    assert (code, out) == (1, "")
    assert "it is not a recording" in err
