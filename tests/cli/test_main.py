"""The command itself: help, version, errors."""

import os
import signal
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest

import piezod
from piezod.cli.exit_codes import exit_code, text_of
from piezod.cli.main import run
from piezod.errors import (
    ConfigError,
    DataError,
    DeviceError,
    DeviceUnavailableError,
    ModelError,
    PiezodError,
    Problem,
    RegistryError,
)
from tests.cli.conftest import Command

VERBS = ("experiment", "identify", "check", "drivers")


def test_version(process: Command) -> None:
    """The version is that of the installed distribution."""
    assert process("--version") == (0, f"piezod {piezod.__version__} ({piezod.build()})\n", "")


def test_help_lists_the_verbs(process: Command) -> None:
    """Help goes to stdout, with one complete line for each command."""
    code, out, err = process("--help")

    assert (code, err) == (0, "")
    lines = [line for line in out.splitlines() if line.split()[:1] and line.split()[0] in VERBS]
    assert [line.split()[0] for line in lines] == list(VERBS)
    assert [line for line in lines if line.endswith("...")] == []


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb(piezod: Command, verb: str) -> None:
    """Every command has a help text and --json."""
    code, out, err = piezod(verb, "--help")

    assert (code, err) == (0, "")
    assert f"Usage: piezod {verb}" in out
    assert "--json" in out


@pytest.mark.parametrize("module", ["main", "output"])
def test_help_and_documents_need_little(module: str) -> None:
    """Help, and printing a JSON document, import no slow library."""
    slow = "{'h5py', 'httpcore', 'matplotlib', 'numba', 'numpy', 'pydantic', 'rich', 'yaml'}"
    code = f"import sys; import piezod.cli.{module}; print({slow} & set(sys.modules))"

    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)

    assert ended.stdout == b"set()\n"


@pytest.mark.parametrize(("own", "used"), [(None, "__all__"), ("logfire", "logfire")])
def test_pydantic_searches_no_plugins(
    piezod: Command, monkeypatch: pytest.MonkeyPatch, own: str | None, used: str
) -> None:
    """A command leaves out pydantic's search for plugins, unless the user has set it otherwise."""
    monkeypatch.setenv("PYDANTIC_DISABLE_PLUGINS", own or "")
    if own is None:
        monkeypatch.delenv("PYDANTIC_DISABLE_PLUGINS")

    assert piezod("--version").code == 0
    assert os.environ["PYDANTIC_DISABLE_PLUGINS"] == used


ENDING = """
import atexit, gc, sys
from piezod.cli.main import run

# The first that is registered is called last.
atexit.register(lambda: print(gc.get_freeze_count() > 0))
sys.argv = ["piezod", "drivers", "--help"]
run()
"""


def test_end_is_quick() -> None:
    """At its end a command leaves its objects to the system: Python does not visit them again."""
    ended = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, check=True)

    assert ended.stdout.endswith(b"True\n")


def test_installed_command_is_this_one() -> None:
    """The entry point `piezod` is the function tested here."""
    (script,) = entry_points(group="console_scripts", name="piezod")

    assert script.load() is run


@pytest.mark.parametrize("arguments", [(), ("nope",), ("experiment",), ("drivers", "--nope")])
def test_wrong_usage(piezod: Command, arguments: tuple[str, ...]) -> None:
    """Wrong usage is reported on stderr and exits with 2."""
    code, out, err = piezod(*arguments)

    assert (code, out) == (2, "")
    assert err.startswith("Usage: piezod")


def because_of(cause: Exception) -> PiezodError:
    """Return the error of an unreadable file with its cause."""
    error = ConfigError(Problem("a.yaml", 0, 0, "", "cannot be read"))
    error.__cause__ = cause
    return error


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigError(Problem("a.yaml", 1, 2, "key", "wrong")), 78),
        (DeviceUnavailableError("absent"), 69),
        (PermissionError(13, "Permission denied", "a.yaml"), 77),
        (because_of(PermissionError(13, "Permission denied", "a.yaml")), 77),
        (because_of(FileNotFoundError(2, "No such file or directory", "a.yaml")), 78),
        (DeviceError("refused"), 1),
        (DataError("gap"), 1),
        (ModelError("no inverse"), 1),
        (RegistryError("unknown driver"), 1),
        (FileNotFoundError(2, "No such file or directory", "a.csv"), 1),
        (KeyboardInterrupt(), 130),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else str(value),
)
def test_exit_codes(
    piezod: Command, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int
) -> None:
    """Every error has its exit code and a text without a traceback; nothing is on stdout."""

    def fail() -> None:
        raise error

    monkeypatch.setattr("piezod.devices.registry.names", fail)

    outcome = piezod("drivers", "--json")

    assert (outcome.code, outcome.out) == (code, "")
    assert "Traceback" not in outcome.err


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (FileNotFoundError(2, "No such file", "a.csv"), "a.csv: No such file"),
        (FileNotFoundError(2, "No such file", b"\xff.csv"), "\udcff.csv: No such file"),
        (OSError("unable to lock file"), "unable to lock file"),
        (DataError("a.csv:3: gap"), "a.csv:3: gap"),
        (because_of(ValueError()), "a.yaml: cannot be read"),
    ],
)  # fmt: skip
def test_texts_of_errors(error: PiezodError | OSError, text: str) -> None:
    """A text begins with the name of the file, if there is one, so that editors can jump to it."""
    assert text_of(error) == text
    assert exit_code(error) != 0


def test_full_disk_is_an_error(folder: Path) -> None:
    """A document that cannot be written is an error."""
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    with full.open("w", encoding="utf-8") as stdout:
        ended = subprocess.run(
            [sys.executable, "-m", "piezod.cli.main", "drivers", "--json"],
            cwd=folder,
            stdout=stdout,
            stderr=subprocess.PIPE,
            check=False,
        )

    assert ended.returncode == 1
    assert b"No space left on device" in ended.stderr
    assert b"Traceback" not in ended.stderr


def test_name_that_is_no_text_can_be_printed(process: Command) -> None:
    """A file name that is not text can be printed in an error."""
    code, out, err = process("identify", "\udcff.csv")

    assert (code, out) == (2, "")
    assert "no such file (got ?.csv)" in err


FILE_ARGUMENTS = [
    ("experiment", "a.file"),
    ("identify", "a.file"),
    ("identify", "b.file", "--test", "a.file"),
    ("check", "a.file"),
]


@pytest.mark.parametrize("arguments", FILE_ARGUMENTS)
def test_a_missing_file_is_wrong_usage_everywhere(
    piezod: Command, folder: Path, arguments: tuple[str, ...]
) -> None:
    """No such file, or a folder in its place, exits with 2 in every command."""
    (folder / "b.file").touch()

    code, out, err = piezod(*arguments)
    assert (code, out) == (2, "")
    assert "no such file (got a.file)" in err

    (folder / "a.file").mkdir()
    code, out, err = piezod(*arguments)
    assert (code, out) == (2, "")
    assert "must be a file, this is a folder (got a.file)" in err


@pytest.mark.parametrize("arguments", [*FILE_ARGUMENTS[:2], FILE_ARGUMENTS[3]])
def test_an_unreadable_file_is_a_matter_of_permission_everywhere(
    piezod: Command, folder: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    """A file that is there and may not be read exits with 77 in every command."""
    (folder / "a.file").touch()

    opened = os.open

    def refuse(path: str | Path, *arguments: Any, **more: Any) -> int:
        if Path(path).name == "a.file":
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *arguments, **more)

    monkeypatch.setattr("os.access", lambda *_, **__: False)
    monkeypatch.setattr("os.open", refuse)

    code, out, err = piezod(*arguments)

    assert (code, out) == (77, "")
    assert "a.file: " in err
    assert "Permission denied" in err


def test_short_help_and_module(piezod: Command, folder: Path) -> None:
    """`-h` and --help are the same, and `python -m piezod` is the command."""
    arguments = (("-h",), ("--help",), ("check", "-h"), ("check", "--help"))
    outs = [piezod(*each).out for each in arguments]
    command = [sys.executable, "-m", "piezod", "check", "-h"]
    module = subprocess.run(command, cwd=folder, capture_output=True, check=True, text=True).stdout

    assert outs[0] == outs[1]
    assert outs[2] == outs[3] == module
    assert module.startswith("Usage: piezod check")


def test_interrupt(piezod: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C is one line on stderr and exits with 130."""
    monkeypatch.setattr("piezod.devices.registry.names", lambda: signal.raise_signal(signal.SIGINT))
    before = signal.getsignal(signal.SIGINT), sys.unraisablehook

    assert piezod("drivers") == (130, "", "interrupted\n")
    assert (signal.getsignal(signal.SIGINT), sys.unraisablehook) == before


SWALLOWED = """
import signal, sys
import piezod.devices.registry as registry
from piezod.cli.main import run

class Thing:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

def names():
    Thing()
    return ()

registry.names = names
sys.argv = ["piezod", "drivers"]
run()
"""


def test_interrupt_that_python_swallows(folder: Path) -> None:
    """Ctrl-C in a destructor, where no exception can be raised, ends the command too."""
    ended = subprocess.run(
        [sys.executable, "-c", SWALLOWED], cwd=folder, capture_output=True, check=False
    )

    assert (ended.returncode, ended.stdout, ended.stderr) == (130, b"", b"interrupted\n")


AGAIN = """
import atexit, signal, sys
import piezod.devices.registry as registry
from piezod.cli.main import run

atexit.register(signal.raise_signal, signal.SIGINT)
registry.names = lambda: signal.raise_signal(signal.SIGINT)
sys.argv = ["piezod", "drivers"]
run()
"""


def test_second_interrupt_at_the_end(folder: Path) -> None:
    """Ctrl-C while Python ends, for example because the first one seemed to be lost, is ignored."""
    ended = subprocess.run(
        [sys.executable, "-c", AGAIN], cwd=folder, capture_output=True, check=False
    )

    assert (ended.returncode, ended.stdout, ended.stderr) == (130, b"", b"interrupted\n")


def test_locale_of_ascii_is_no_limit(tmp_path: Path) -> None:
    """In a locale without UTF-8 an umlaut in a path is read, and printed, as it is."""
    file = tmp_path / "Prüfstand µ.yaml"
    file.write_text("rate_hz: 0\n", encoding="utf-8")
    ascii_only = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    ended = subprocess.run(
        [sys.executable, "-m", "piezod", "check", str(file)],
        env={**os.environ, **ascii_only},
        capture_output=True,
        check=False,
    )

    assert ended.returncode == 78
    assert str(file) in ended.stderr.decode()
