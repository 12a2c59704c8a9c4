"""Records of other programs on the command line."""

import json
from pathlib import Path

import numpy as np
import pytest

from piezod.config.model_file import load_model
from tests.cli.conftest import Command
from tests.experiment.made_up import record_of, write_record

COLUMNS = ("--columns", "t=TIME,drive=CH1,position=CH2", "--scale", "drive=20,position=2")


@pytest.fixture
def scope(folder: Path) -> Path:
    """Return a file of a scope: monitor of the drive and sensor, in V, and the record itself."""
    record = record_of()
    write_record(folder / "plain.csv", record)
    columns = (record.t_s, record.drive_v / 20.0, record.position_um / 2.0)
    rows = (";".join(map(repr, row)) for row in np.stack(columns, axis=1).tolist())
    text = "Horizontal Units;S\nVertical Units;V;V\nTIME;CH1;CH2\n" + "\n".join(rows)
    (folder / "scope.csv").write_text(text.replace(".", ","), encoding="utf-16")
    return Path("scope.csv")


def test_model_of_a_scope_is_that_of_the_record(piezod: Command, scope: Path, folder: Path) -> None:
    """What was understood is in the report, the document and the model file."""
    fit = ("--method", "least-squares", "--order", 6)
    plain = json.loads(piezod("identify", "plain.csv", *fit, "--json").out)
    code, out, _ = piezod("identify", scope, *COLUMNS, *fit, "--out", "m.yaml", "--test", scope)

    assert code == 0
    assert "drive_v = 20 · 'CH1', which is in V." in out
    source = load_model(folder / "m.yaml").source
    assert source.read_as is not None
    assert "UTF-16, separated by semicolons, decimal comma" in source.read_as
    document = json.loads(piezod("identify", scope, *COLUMNS, *fit, "--json").out)
    assert plain["read_as"] == []
    assert document["read_as"][-1] == "position_um = 2 · 'CH2', which is in V."
    assert document["train"] == pytest.approx(plain["train"], rel=1e-6)


def test_columns_that_cannot_be_told_are_asked_for(piezod: Command, scope: Path) -> None:
    """The error has the command; options for a recording or for --live are refused."""
    code, _, err = piezod("identify", scope)

    assert code == 1
    assert "'CH1' and 'CH2' may be it" in err
    assert "--columns t=TIME,drive=CH1,position=CH2 --scale position=UM_PER_V" in err
    assert piezod("identify", "--live", "--rate-hz", 5).code == 2
    assert f"piezod import {scope} --columns" in piezod("import", scope).err
    assert piezod("identify", scope, "--scale", "drive=x").code == 2
    assert piezod("identify", "none.h5:/group").code == 2


def test_import_shows_and_writes(piezod: Command, scope: Path, folder: Path) -> None:
    """The record is written as piezod writes it, with a picture."""
    code, out, _ = piezod("import", scope, *COLUMNS, "--out", "record.csv")

    assert code == 0
    assert "2500 samples at 100 Hz" in out
    assert "position_um from 0 to" in out
    assert (folder / "record.png").read_bytes().startswith(b"\x89PNG")
    written = np.loadtxt(folder / "record.csv", delimiter=",", skiprows=1)
    assert written == pytest.approx(np.loadtxt(folder / "plain.csv", delimiter=",", skiprows=1))
    document = json.loads(piezod("import", "record.csv", "--json").out)
    assert document["read_as"] == []
    assert document["samples"] == 2500
    assert document["file"] is None


def test_the_file_that_is_read_stays(piezod: Command, scope: Path) -> None:
    """No output replaces it, under no name."""
    before = scope.read_bytes()
    Path("alias.csv").symlink_to(scope)

    for out in ("scope.csv", "./scope.csv", "alias.csv"):
        assert piezod("import", scope, *COLUMNS, "--out", out).code == 2
        assert piezod("voltages", scope, scope, "--out", out).code == 2
    assert scope.read_bytes() == before


def test_position_that_falls_is_turned(piezod: Command, scope: Path) -> None:
    """`--invert` and `--offset` make it rise, as the sensor of a mirror needs."""
    options = (*COLUMNS, "--invert", "position", "--offset", "position=30", "--json")
    document = json.loads(piezod("import", scope, *options).out)

    assert document["position_um"][1] == pytest.approx(30.0)
    assert "-2 · 'CH2' +30" in document["read_as"][-1]
