"""`piezod demo`."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.experiment.progress import Progress
from piezod.experiment.virtual.run import run_experiment
from piezod.records.experiment_result import ExperimentResult
from tests.cli.conftest import Command

PAPER = Path(__file__).parents[2] / "config" / "experiments" / "qiu.yaml"
RESULTS: dict[str, ExperimentResult] = {}


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the configurations that ran; only a short part of each does, and only once."""
    texts: list[str] = []

    def run_in_short(
        config: ExperimentConfig, text: str, title: str, progress: Progress
    ) -> ExperimentResult:
        texts.append(text)
        assert config.identification is not None
        brief = config.identification.model_copy(update={"settle_s": 0.0, "duration_s": 5.0})
        cases = tuple(
            each.model_copy(update={"period_s": 0.1, "duration_s": 0.5}) for each in config.cases
        )
        changed = {"identification": brief, "cases": cases, "settle_s": 0.0}
        key = repr((config, text, title))
        if key not in RESULTS:
            result = run_experiment(config.model_copy(update=changed), text, title, progress)
            RESULTS[key] = replace(result, warnings=())
        return RESULTS[key]

    monkeypatch.setattr("piezod.cli.experiment.run.run_experiment", run_in_short)
    return texts


@pytest.mark.usefixtures("blank_figures")
def test_the_experiment_of_the_paper_runs_from_any_folder(
    piezod: Command, folder: Path, ran: list[str]
) -> None:
    """It needs no file in the folder, and ends with the errors of the paper and the report."""
    code, out, err = piezod("demo")

    assert (code, err) == (0, "")
    assert ran == [PAPER.read_text(encoding="utf-8")]
    lines = [line.split() for line in out.splitlines()]
    published = [words[-1] for words in lines if {"feedforward", "adaptive"} & set(words[:3])]
    assert published == ["1.87", "1.49", "2.17", "1.86", "2.31", "2.02"]
    assert out.endswith("Report: piezod-demo/report.html\n")
    page = (folder / "piezod-demo" / "report.html").read_text(encoding="utf-8")
    assert [f"As in Fig. {number} of the paper" in page for number in range(5, 13)] == [
        False, *[True] * 6, False,
    ]  # fmt: skip


@pytest.mark.usefixtures("blank_figures", "ran")
def test_document_and_folder(piezod: Command, folder: Path) -> None:
    """With --out the results are in that folder; --json prints the document of `experiment`."""
    code, out, err = piezod("demo", "--out", "here", "--json")

    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["report"] == "here/report.html"
    assert len(document["cases"]) == 9
    assert {each.name for each in folder.iterdir()} == {"here"}
