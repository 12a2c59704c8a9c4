"""`piezod acceptance`."""

import json
import subprocess
from pathlib import Path

import pytest

from piezod.cli.devices import acceptance_run
from piezod.daemon.loop.machine import Machine
from tests.cli.conftest import Command
from tests.evidence import records

STAGE = Path(__file__).parents[2] / "config" / "simulated.yaml"
FOUND = {"axis": "x", "found": [{"name": "noise"}], "not_done": [], "sheet": "/home/me/sheet.html"}


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a key, and let the machine be measured at once."""
    machine = Machine(10.0, 0.0, {}, 0.95, 1000, ())
    monkeypatch.setattr(acceptance_run, "measure_machine", lambda _: machine)
    path = tmp_path / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", path], check=True)  # noqa: S607
    return path


def signed(record: Path) -> bool:
    """Return whether a record is the one that was signed."""
    command = ("ssh-keygen", "-Y", "check-novalidate", "-n", "piezod", "-s", f"{record}.sig")
    with record.open("rb") as text:
        ended = subprocess.run(command, stdin=text, check=False, capture_output=True)
    return ended.returncode == 0


def test_record_is_signed_evidence(piezod: Command, tmp_path: Path, key: Path) -> None:
    """It holds device, steps and faults; its signature does not fit another text."""
    (tmp_path / "found.json").write_text(json.dumps(FOUND), "utf-8")
    record = tmp_path / "docs" / "hardware" / "rig.json"
    record.parent.mkdir(parents=True)
    code, out, _ = piezod(
        *("acceptance", str(STAGE), "--by", "A. Person", "--key", str(key), "--out", str(record)),
        *("--commissioned", str(tmp_path / "found.json"), "--fault", "cable pulled: B1"),
    )
    found = json.loads(record.read_text("utf-8"))

    assert (code, str(record) in out) == (0, True)
    assert found["device"]["identity"]["model"] == "simulated stack"
    assert found["device"]["read"]["failed_pct"] == 0.0
    assert found["commissioned"] == {key: FOUND[key] for key in ("axis", "found", "not_done")}
    assert found["faults"] == ["cable pulled: B1"]
    (row,) = records(record.parent)
    assert row[:2] == ("simulated", "simulated")
    assert (row.by, row.kind) == ("A. Person", "hardware")
    assert signed(record)
    record.write_text(record.read_text("utf-8").replace("A. Person", "B. Person"), "utf-8")
    assert not signed(record)


def test_record_without_key_is_no_record(piezod: Command, tmp_path: Path, key: Path) -> None:
    """A key that does not exist is named, and no signature is left."""
    out = tmp_path / "rig.json"
    wrong = str(key) + "-of-nobody"
    code, _, err = piezod("acceptance", str(STAGE), "--by", "me", "--key", wrong, "--out", str(out))
    assert (code, "was not signed" in err) == (1, True)
    assert not out.with_name("rig.json.sig").exists()


def test_wrong_commissioning_is_named(piezod: Command, tmp_path: Path, key: Path) -> None:
    """A file that is no output of `piezod commission --json` is refused before anything opens."""
    (tmp_path / "other.json").write_text("{}", "utf-8")
    code, _, err = piezod(
        *("acceptance", str(STAGE), "--by", "me", "--key", str(key)),
        *("--commissioned", str(tmp_path / "other.json")),
    )
    assert (code, "other.json" in err) == (1, True)
