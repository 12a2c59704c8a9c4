"""The command, run within this process and as a process of its own."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from piezod.cli import main
from piezod.cli.devices import guardian
from piezod.experiment.fit.file import FileFit, identify_file
from tests.client.fake_daemon import STATUS, FakeDaemon
from tests.client.group_of_fakes import daemons  # noqa: F401 - a fixture
from tests.experiment.conftest import SLOW_LOOP
from tests.forked import ForkedGuardian


class Outcome(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


Command = Callable[..., Outcome]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the empty folder in which commands run, on a console of 100 columns."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    return tmp_path


@pytest.fixture
def piezod(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Command:
    """Return a function that runs the command within this process, which is quick."""
    started = SimpleNamespace(Popen=ForkedGuardian, PIPE=subprocess.PIPE)
    monkeypatch.setattr(guardian, "subprocess", started)

    def call(*arguments: object) -> Outcome:
        assert Path.cwd() == folder
        monkeypatch.setattr(sys, "argv", ["piezod", *map(str, arguments)])
        monkeypatch.setattr(sys, "excepthook", sys.excepthook)  # typer puts its own there
        with pytest.raises(SystemExit) as ended:
            main.run()
        return Outcome(int(ended.value.code or 0), *capsys.readouterr())

    return call


FITS: dict[str, FileFit] = {}


@pytest.fixture
def fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit files once for the same options, however the fit is shown, because it takes seconds."""

    def known(data: Path, **options: Any) -> FileFit:
        del options["progress"]
        contents = [file.read_bytes() for file in (data, options["test"]) if file]
        key = repr((data, options, contents))
        return FITS.get(key) or FITS.setdefault(key, identify_file(data, **options))

    monkeypatch.setattr("piezod.cli.identify.run.identify_file", known)


@pytest.fixture
def process(folder: Path) -> Command:
    """Return a function that runs the command as a process of its own."""

    def call(*arguments: object) -> Outcome:
        command = [sys.executable, "-m", "piezod.cli.main", *map(str, arguments)]
        ended = subprocess.run(
            command, cwd=folder, capture_output=True, encoding="utf-8", check=False
        )
        return Outcome(ended.returncode, ended.stdout, ended.stderr)

    return call


@pytest.fixture
def experiment_file(folder: Path) -> Path:
    """Return the path of an experiment that takes half a second, relative to the folder."""
    (folder / "short.yaml").write_text(SLOW_LOOP, encoding="utf-8")
    return Path("short.yaml")


@pytest.fixture
def daemon(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeDaemon]:
    """Return a daemon that accepts everything; it is the one that verbs talk to."""
    daemon = FakeDaemon(folder / "api.sock")
    daemon.answers["GET status"] = STATUS
    monkeypatch.setenv("PIEZOD_SOCKET", str(daemon.socket_path))
    with daemon.running():
        yield daemon
