"""`piezod init`: written files, and files that stay."""

import json
from pathlib import Path

import pytest

from piezod.cli.daemon.shipped import shipped
from tests.cli.conftest import Command


def files(folder: Path) -> dict[str, bytes]:
    """Return the content of every file below a folder."""
    found = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def test_examples_are_those_of_the_package(piezod: Command, folder: Path) -> None:
    """Every configuration, model and experiment is written unchanged."""
    code, out, _ = piezod("init")

    assert code == 0
    assert files(folder / "config") == files(shipped("config"))
    assert "piezod run config/simulated.yaml" in out


def test_examples_are_valid_where_they_were_written(piezod: Command, folder: Path) -> None:
    """The examples come with all files that they refer to."""
    piezod("init", folder / "mine")
    mine = folder / "mine"
    for example in sorted([*(mine / "experiments").iterdir(), *mine.glob("devices/*.yaml")]):
        code, _, err = piezod("check", example)

        assert (code, err) == (0, "")


def test_a_changed_file_stays(piezod: Command, folder: Path) -> None:
    """A changed file is named, nothing is written, and the exit code is 1."""
    changed = folder / "config" / "simulated.yaml"
    changed.parent.mkdir()
    changed.write_text("mine")
    code, _, err = piezod("init")

    assert code == 1
    assert "config/simulated.yaml" in err
    assert "emulated.yaml" not in err
    assert files(folder / "config") == {"simulated.yaml": b"mine"}


def test_force_overwrites(piezod: Command, folder: Path) -> None:
    """--force replaces a changed file and no other; the document lists the written files."""
    piezod("init")
    (folder / "config" / "simulated.yaml").write_text("mine")
    (folder / "config" / "stage1.yaml").write_text("mine")
    code, out, _ = piezod("init", "--force", "--json")

    assert code == 0
    assert json.loads(out) == {"folder": "config", "written": ["simulated.yaml"]}
    assert files(folder / "config") == {**files(shipped("config")), "stage1.yaml": b"mine"}


def test_again_is_nothing_to_do(piezod: Command) -> None:
    """Unchanged examples are no reason to refuse."""
    piezod("init")
    code, out, _ = piezod("init")

    assert code == 0
    assert "all examples exist already" in out


def test_folder_that_is_a_file(piezod: Command, folder: Path) -> None:
    """A file in place of the folder is an error with its name, without a traceback."""
    (folder / "config").write_text("")
    code, _, err = piezod("init")

    assert code == 1
    assert err.startswith("config")


def test_wheel_has_its_own_copy(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files are in an installed package, and beside it in a checkout."""
    package = folder / "piezod"
    (package / "data" / "systemd").mkdir(parents=True)
    monkeypatch.setattr("piezod.__file__", str(package / "__init__.py"))

    assert shipped("systemd") == package / "data" / "systemd"
    assert shipped("config") == folder / "config"
