"""The progress bar of long commands."""

import contextlib
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from piezod.cli.progress import AS_JSON, progress_bar, report_part


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


def test_progress_is_lines_of_json_for_a_program_that_asks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each activity and each half percent is a line; a part of the result is one, too."""
    monkeypatch.setenv(AS_JSON, "json")
    with progress_bar() as progress:
        for share in (0.0, 0.001, 0.004, 0.006):
            progress("driving", share)
        progress("fitting", 0.006)
    report_part({"label": "pass 1"})

    out, lines = capsys.readouterr()
    assert out == ""
    assert [json.loads(line) for line in lines.splitlines()] == [
        {"activity": "driving", "share": 0.0},
        {"activity": "driving", "share": 0.006},
        {"activity": "fitting", "share": 0.006},
        {"part": {"label": "pass 1"}},
    ]


def test_unknown_numbers_of_a_part_are_null(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A page could not read NaN."""
    monkeypatch.setenv(AS_JSON, "json")
    report_part({"true_px": {"fast_max": float("nan")}})

    assert capsys.readouterr().err == '{"part": {"true_px": {"fast_max": null}}}\n'
