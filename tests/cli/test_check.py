"""`piezod check`."""

import json
from pathlib import Path

from tests.cli.conftest import Command


def test_good_experiment(process: Command, experiment_file: Path) -> None:
    """A file that can be used is ok, and a person reads what it holds."""
    expected = "short.yaml: ok, an experiment: 1 case in 3 modes on 1 axis\n"
    assert process("check", experiment_file) == (0, expected, "")


def test_good_experiment_for_programs(piezod: Command, experiment_file: Path) -> None:
    """The document tells the kind and that there are no problems."""
    code, out, err = piezod("check", experiment_file, "--json")

    assert (code, err) == (0, "")
    assert json.loads(out) == {
        "file": "short.yaml",
        "kind": "experiment",
        "ok": True,
        "problems": [],
    }


def test_mistakes_are_all_told(process: Command, experiment_file: Path) -> None:
    """Every problem is a line on stderr with its place, and the exit code is 78."""
    text = experiment_file.read_text(encoding="utf-8")
    text = text.replace("rate_hz: 1000", "rate_hz: fast").replace("driver: simulated", "driver: x")
    experiment_file.write_text(text, encoding="utf-8")

    assert process("check", experiment_file) == (
        78,
        "",
        "short.yaml:1:10: rate_hz: must be a number (got 'fast'), allowed range 10 to 20000 Hz\n"
        "short.yaml:4:17: devices.rig.driver: unknown driver (got 'x'), known: simulated\n",
    )


def test_mistakes_for_programs(piezod: Command, experiment_file: Path) -> None:
    """With --json the problems are in the document as well as on stderr."""
    text = experiment_file.read_text(encoding="utf-8")
    experiment_file.write_text(text.replace("seed: 3", "seed: -3"), encoding="utf-8")

    code, out, err = piezod("check", experiment_file, "--json")

    what = "out of range (got -3), allowed range 0 to 4294967295"
    problem = {"file": "short.yaml", "line": 2, "column": 7, "path": "seed", "what": what}
    assert json.loads(out) == {
        "file": "short.yaml",
        "kind": "experiment",
        "ok": False,
        "problems": [problem],
    }
    assert (code, err) == (78, f"short.yaml:2:7: seed: {what}\n")


def test_file_that_is_not_there(piezod: Command) -> None:
    """The error names the file."""
    assert piezod("check", "nowhere.yaml") == (
        78,
        "",
        "nowhere.yaml: cannot be read: No such file or directory\n",
    )
