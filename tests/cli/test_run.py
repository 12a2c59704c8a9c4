"""`piezod run`: refusals before the loop process starts."""

from pathlib import Path

import pytest

from piezod.daemon.lock import Lock
from piezod.daemon.paths import stage_paths
from tests.cli.conftest import Command
from tests.forked import run


@pytest.fixture
def config(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an invalid configuration; all files stay in the folder."""
    for name in ("RUNTIME_DIRECTORY", "STATE_DIRECTORY"):
        monkeypatch.setenv(name, str(folder / name.lower()))
    path = folder / "lab.yaml"
    path.write_text("rate_hz: 0\n", encoding="utf-8")
    return path


def test_bad_configuration(config: Path) -> None:
    """An invalid configuration exits with 78, and every problem has its place."""
    ended = run(("run", str(config)))

    assert (ended.returncode, ended.stdout) == (78, "")
    assert f"{config}:1:10: rate_hz: out of range" in ended.stderr
    assert "devices" in ended.stderr


def test_stage_that_runs_already(piezod: Command, config: Path) -> None:
    """A second daemon is refused before it reads the configuration."""
    paths = stage_paths(config)
    paths.make_folders()
    with Lock(paths.lock):
        code, _, err = piezod("run", config)

    assert code == 75
    assert "this stage is already running" in err


@pytest.mark.fault("P9")
def test_stage_that_runs_with_another_runtime_folder(
    piezod: Command, config: Path, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    """A second daemon of the same stage is refused, whatever its runtime folder is."""
    paths = stage_paths(config)
    paths.make_folders()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(folder / "another"))
    with Lock(paths.lock):
        code, _, err = piezod("run", config)

    assert (code, str(paths.lock) in err) == (75, True)


def test_missing_file(piezod: Command, config: Path) -> None:
    """A missing file exits with 2, as for every command."""
    assert piezod("run", config.with_name("other.yaml")).code == 2


def test_name_that_no_folder_can_have(piezod: Command, config: Path) -> None:
    """A file name that cannot be the name of a stage is refused."""
    hidden = config.with_name(".yaml")
    hidden.touch()

    code, _, err = piezod("run", hidden)

    assert code == 78
    assert "must not begin with a dot" in err


@pytest.mark.fault("P12")
def test_folder_open_to_other_users(piezod: Command, config: Path) -> None:
    """A folder that other users can write to exits with 77 and is named."""
    paths = stage_paths(config)
    paths.make_folders()
    paths.runtime.chmod(0o777)

    code, _, err = piezod("run", config)

    assert code == 77
    assert f"{paths.runtime}: must be a folder of this user" in err


def test_experiment_is_no_stage(experiment_file: Path) -> None:
    """`run` of an experiment names the command for it, and lists no keys."""
    ended = run(("run", str(experiment_file)))

    assert ended.returncode == 78
    wanted = "this is an experiment, not a stage: run it with `piezod experiment`"
    assert wanted in ended.stderr
    assert "unknown key" not in ended.stderr
