"""The progress bar of long commands."""

import contextlib
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from piezod.cli.progress import progress_bar


def read_all(terminal: int) -> str:
    """Return everything written to a terminal until it is closed."""
    shown = b""
    with contextlib.suppress(OSError):  # how Linux says that it is closed
        while part := os.read(terminal, 4096):
            shown += part
    return shown.decode()


@pytest.mark.stress
def test_bar_is_shown_on_a_terminal(folder: Path, experiment_file: Path) -> None:
    """The present activity is shown on a terminal; stdout has the document only."""
    with (folder / experiment_file).open("a", encoding="utf-8") as file:
        file.write("modes: [feedforward]\n")
    terminal, stderr = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "piezod.cli.main", "experiment", experiment_file, "--json"],
        cwd=folder,
        env={**os.environ, "TERM": "xterm"},
        stdout=subprocess.PIPE,
        stderr=stderr,
    ) as running:
        os.close(stderr)
        shown = read_all(terminal)
        out, _ = running.communicate()
    os.close(terminal)

    assert len(json.loads(out)["cases"]) == 1
    assert "100%" in shown
    assert "writing the report" in shown


def test_no_bar_in_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    """If stderr is no terminal, nothing is written to it."""
    with progress_bar() as progress:
        progress("running", 0.5)

    assert capsys.readouterr() == ("", "")
