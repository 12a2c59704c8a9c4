"""An experiment with `play` on a running stage: its outputs, and what is refused."""

import json
from contextlib import nullcontext
from pathlib import Path

import pytest

from piezod.config.experiment import load_experiment
from piezod.devices import registry
from piezod.errors import DataError
from piezod.experiment.live.run_plays import run_plays_live
from tests.cli.conftest import Command, folder, piezod
from tests.experiment.live.playing_stage import PlayingStage
from tests.experiment.play.test_run import SHORT, file, fitted_once, undrawn

__all__ = ["file", "fitted_once", "folder", "piezod", "undrawn"]


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> PlayingStage:
    """Return the stage to which the command connects."""
    running = PlayingStage()
    monkeypatch.setattr("piezod.cli.experiment.experiment.connect", lambda *_: nullcontext(running))
    return running


def test_document_and_files(piezod: Command, stage: PlayingStage, file: Path, folder: Path) -> None:
    """The errors fall from play to play, the truth is not known; a figure and a table are written.

    The stage is disarmed at the end.
    """
    code, out, err = piezod("experiment", file, "--live", "--json", "--out", "out")
    assert (code, err) == (0, "")
    document = json.loads(out)
    (wave,) = document["axes"]["x"]["waves"]

    labels = ["inverse model", "inverse and response", "pass 1", "pass 2", "pass 3"]
    assert [play["label"] for play in wave["plays"]] == labels[: len(wave["plays"])]
    worst = [play["measured"]["max_pct"] for play in wave["plays"]]
    assert worst[0] > 5.0
    assert 3.0 > worst[1] > worst[-1]
    assert {play["true"]["max_pct"] for play in wave["plays"]} == {None}
    assert document["title"] == "short (live on stage fake)"
    assert any("with its own configuration" in each for each in document["warnings"])
    assert sorted(path.name for path in (folder / "out").iterdir()) == [
        "play_x_01.png",
        "table_x_01.yaml",
    ]
    assert (stage.state, stage.asked[-1]) == ("SAFE", "end of the session")


@pytest.mark.usefixtures("stage", "undrawn")
def test_text_has_no_true_errors_and_a_stored_table_is_used(piezod: Command, file: Path) -> None:
    """No running stage knows its true displacement; `--tables` is as in virtual time."""
    file.write_text(SHORT.replace("passes: 3", "passes: 0"), encoding="utf-8")
    code, out, err = piezod("experiment", file, "--live", "--out", "out")

    assert (code, err) == (0, "")
    assert "measured" in out
    assert "true" not in out
    assert "! Run on stage fake with its own configuration" in out

    code, out, err = piezod("experiment", file, "--live", "--out", "again", "--tables", "out")

    assert (code, err) == (0, "")
    assert "stored table" in out
    assert "begins with table_x_01.yaml" in out


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("high: 24", "high: 27", "sine 200 Hz commands 4 to 27 µm, but axis x may be commanded"),
        ("\n  x:\n", "\n  z:\n", "stage fake: no axis z; its axes are x"),
        ("frequency_hz: 200", "frequency_hz: 202", "sine 200 Hz has 99.0099 points per period"),
    ],
)
def test_experiment_that_does_not_fit_moves_nothing(
    file: Path, old: str, new: str, problem: str
) -> None:
    """Everything that is known before the first request is reported before it."""
    assert old in SHORT
    file.write_text(SHORT.replace(old, new), encoding="utf-8")
    config, stage = load_experiment(file, registry), PlayingStage()
    assert config.play is not None

    with pytest.raises(DataError, match=problem):
        run_plays_live(config, config.play, stage, lambda _label, _share: None)

    assert not {"arm", "play", "session"} & set(stage.asked)


def test_multisine_that_is_too_fast_is_named(file: Path) -> None:
    """The error says that the response was being measured, and the stage is left disarmed."""
    text = SHORT.replace("passes: 3", "passes: 3\n  amplitude_pct: 20")
    file.write_text(text, encoding="utf-8")
    config, stage = load_experiment(file, registry), PlayingStage(response=None)
    assert config.play is not None

    with pytest.raises(DataError, match="response: the table is refused: "):
        run_plays_live(config, config.play, stage, lambda _label, _share: None)

    assert stage.state == "SAFE"
