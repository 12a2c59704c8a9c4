"""`.ci/test-all` with interpreters and a set-up that are stand-ins."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

CI = Path(__file__).parents[1] / ".ci"
# It answers the question for its version as a Python of that version does.
PYTHON = """#!/bin/sh
case "$2" in *"'{version}'"*) exit 0;; *) exit 1;; esac
"""
SHIM = "#!/bin/sh\nexit 127\n"
"""Of pyenv, without this version; it hides a Python of the machine."""
SET_UP = """#!/bin/sh
mkdir -p "$1/bin"
printf '#!/bin/sh\\necho "$0 $*"\\ntest ! -e failing\\n' >"$1/bin/python"
chmod +x "$1/bin/python"
"""


def program(path: Path, text: str) -> None:
    """Write a program."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)


def run(folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a copy of the script in a folder, with the interpreters in `bin` and `pyenv` there."""
    program(folder / ".ci" / "setup", SET_UP)
    for name in ("test-all", "environment.sh"):
        shutil.copy(CI / name, folder / ".ci")
    environ = {"PATH": f"{folder}/bin:/usr/bin:/bin", "PYENV_ROOT": f"{folder}/pyenv"}
    return subprocess.run(
        [str(folder / ".ci" / "test-all"), "--quiet"],
        env=environ | {"HOME": os.fspath(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def interpreters(tmp_path: Path) -> Path:
    """Return a folder with two interpreters on PATH, and one in pyenv behind a shim that fails."""
    for version in ("3.11", "3.13"):
        program(tmp_path / "bin" / f"python{version}", PYTHON.format(version=version))
    program(tmp_path / "bin" / "python3.12", SHIM)
    behind = tmp_path / "pyenv/versions/3.12.1/bin/python"
    program(behind, PYTHON.format(version="3.12"))
    return tmp_path


def test_each_version_is_tested(interpreters: Path) -> None:
    """Each version has an environment of its own, and pytest gets the arguments."""
    ended = run(interpreters)

    assert (ended.returncode, ended.stderr) == (0, "")
    versions = ("3.11", "3.12", "3.13")
    started = [f"build/python{version}/bin/python -m pytest --quiet" for version in versions]
    assert ended.stdout.splitlines()[:-1] == started
    assert ended.stdout.splitlines()[-1] == (
        "piezod: Python 3.11: passed. Python 3.12: passed. Python 3.13: passed."
    )


def test_missing_version_is_a_failure(interpreters: Path) -> None:
    """A missing version is reported with its remedy; the others are tested all the same."""
    program(interpreters / "bin" / "python3.13", SHIM)
    shutil.rmtree(interpreters / "pyenv")
    ended = run(interpreters)

    assert ended.returncode == 2
    assert "no Python 3.12 on PATH or in pyenv; install it: pyenv install 3.12" in ended.stderr
    assert "Python 3.11: passed. Python 3.12: missing. Python 3.13: missing." in ended.stdout


def test_failing_tests_are_a_failure(interpreters: Path) -> None:
    """The exit code is the number of versions that failed."""
    (interpreters / "failing").touch()
    ended = run(interpreters)

    assert ended.returncode == 3
    assert "Python 3.12: failed." in ended.stdout
