"""`piezod check`."""

import json
from pathlib import Path

import pytest

from piezod.cli.daemon.shipped import shipped
from piezod.cli.experiment import processor_warnings
from piezod.config.model_file import dump_model
from piezod.devices import registry
from tests.cli.conftest import Command
from tests.control.surface_rig import surface_file


def test_good_experiment(piezod: Command, experiment_file: Path) -> None:
    """A valid file is ok, and the text describes its contents."""
    expected = "short.yaml: ok, an experiment: 1 case in 3 modes on 1 axis\n"
    assert piezod("check", experiment_file) == (0, expected, "")


def test_good_experiment_for_programs(piezod: Command, experiment_file: Path) -> None:
    """The document has the kind of the file and no problems."""
    code, out, err = piezod("check", experiment_file, "--json")

    assert (code, err) == (0, "")
    assert json.loads(out) == {
        "file": "short.yaml",
        "kind": "experiment",
        "ok": True,
        "problems": [],
        "warnings": [],
        "margins": [],
    }


def test_all_problems_are_reported(piezod: Command, experiment_file: Path) -> None:
    """Every problem is a line on stderr with its place, and the exit code is 78."""
    text = experiment_file.read_text(encoding="utf-8")
    text = text.replace("rate_hz: 200", "rate_hz: fast").replace("driver: simulated", "driver: x")
    experiment_file.write_text(text, encoding="utf-8")

    known = ", ".join(registry.names())
    assert piezod("check", experiment_file) == (
        78,
        "",
        "short.yaml:1:10: rate_hz: must be a number (got 'fast'), allowed range 10 to 20000 Hz\n"
        f"short.yaml:4:17: devices.rig.driver: unknown driver (got 'x'), known: {known}\n",
    )


def test_problems_for_programs(piezod: Command, experiment_file: Path) -> None:
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
        "warnings": [],
        "margins": [],
    }
    assert (code, err) == (78, f"short.yaml:2:7: seed: {what}\n")


def test_file_that_is_not_there(piezod: Command) -> None:
    """A missing file is wrong usage, and the error names it."""
    code, out, err = piezod("check", "nowhere.yaml")

    assert (code, out) == (2, "")
    assert "no such file (got nowhere.yaml)" in err


def spoilt(folder: Path) -> Path:
    """Write a model whose inverse is not monotone into the folder, and return its path."""
    path = folder / "steep.yaml"
    weights = {"right_stop_weights": [-2.0], "left_stop_weights": [-2.0]}
    thresholds = {"right_stop_thresholds": [0.5], "left_stop_thresholds": [0.5]}
    model = {
        "created_at": "2024-05-01T12:00:00+00:00",
        "created_by": "a test",
        "method": "lms",
        "source": {"file": "data.csv", "sha256": 64 * "0"},
        "fit": {"voltage_error_max_pct": 1.0, "voltage_error_rms_pct": 0.5},
        "drive_low_v": 0.0,
        "drive_high_v": 150.0,
        "position_low_um": 0.0,
        "position_high_um": 30.0,
        "delay_s": 0.0,
        **thresholds,
        **weights,
    }
    path.write_text(json.dumps(model), encoding="utf-8")
    return path


def test_model_that_is_not_monotone(piezod: Command, folder: Path) -> None:
    """A model that is not monotone is a problem, with a remedy."""
    spoilt(folder)

    code, out, err = piezod("check", "steep.yaml")
    document = json.loads(piezod("check", "steep.yaml", "--json").out)

    assert (code, out) == (78, "")
    assert err.startswith("steep.yaml: the model is not monotone: its smallest slope is ")
    assert err.endswith("identify again\n")
    assert (document["kind"], document["ok"]) == ("model", False)
    assert [problem["file"] for problem in document["problems"]] == ["steep.yaml"]


def test_experiment_with_a_model_that_is_not_monotone(
    piezod: Command, experiment_file: Path, folder: Path
) -> None:
    """The problem is reported for the file of the model."""
    spoilt(folder)
    text = experiment_file.read_text(encoding="utf-8")
    head, tail = text.split("identification:")
    rest = tail[tail.index("settle_s: 0.5\ncases") :]
    experiment_file.write_text(f"{head}    model: steep.yaml\n{rest}", encoding="utf-8")

    code, out, err = piezod("check", experiment_file)

    assert (code, out) == (78, "")
    assert "steep.yaml: the model is not monotone" in err


def test_surface(piezod: Command, folder: Path) -> None:
    """A model file of version 2 is described; a broken one is a problem with its place."""
    text = dump_model(surface_file())
    (folder / "good.yaml").write_text(text, encoding="utf-8")
    (folder / "broken.yaml").write_text(text.replace("version: 2", "version: 1"), encoding="utf-8")

    good = piezod("check", "good.yaml")
    broken = piezod("check", "broken.yaml")

    assert (good.code, good.err) == (0, "")
    assert "a model: a surface, by surface" in good.out
    assert broken.code == 78
    assert (
        "surface_coefficients: a file of version 1 has 0 surface_coefficients (got 24)"
        in broken.err
    )


@pytest.mark.parametrize(
    ("loop", "free", "warning"),
    [
        ("", [], "! each of the processors 0, 1 has the loop of another stage already"),
        ("", [1], ""),
        ("", None, ""),
        ("loop: {cpu: 1}\n", [], "! processor 1 (loop.cpu) has the loop of another stage already"),
        (
            "loop: {cpu: 7}\n",
            [7],
            "! loop.cpu is 7, and this user may use the processors 0, 1 only",
        ),
    ],
)
def test_processor_that_would_be_shared(
    piezod: Command,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    loop: str,
    free: list[int] | None,
    warning: str,
) -> None:
    """A stage that would share its processor, or cannot have it, is valid with a warning."""
    monkeypatch.setattr(processor_warnings, "running_stages", dict)
    monkeypatch.setattr(processor_warnings, "free_processors", lambda _candidates: free)
    monkeypatch.setattr("os.sched_getaffinity", lambda _process: {0, 1})
    config = shipped("config") / "simulated.yaml"
    text = config.read_text(encoding="utf-8").replace("model: ", f"model: {config.parent}/")
    (folder / "stage.yaml").write_text(text + loop, encoding="utf-8")

    code, out, err = piezod("check", "stage.yaml")

    assert (code, err) == (0, "")
    assert out.partition("\n")[2].startswith(warning)
    assert ("!" in out) == bool(warning)
