"""Tests that the paper's experiment reaches the paper's errors, on any stage."""

from collections.abc import Callable
from pathlib import Path

import pytest

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.modes import Mode
from piezod.devices import registry
from piezod.experiment.virtual.run import run_experiment
from piezod.records.experiment_result import Recording

QIU = Path(__file__).parents[3] / "config" / "experiments" / "qiu.yaml"

PAPER_PCT = {
    ("case 1", Mode.FEEDFORWARD): 1.87,
    ("case 2", Mode.FEEDFORWARD): 2.17,
    ("case 3", Mode.FEEDFORWARD): 2.31,
    ("case 1", Mode.ADAPTIVE): 1.49,
    ("case 2", Mode.ADAPTIVE): 1.86,
    ("case 3", Mode.ADAPTIVE): 2.02,
}


def brief(config: ExperimentConfig) -> ExperimentConfig:
    """Return an experiment with half the rate, and the first half of its first case."""
    half = config.cases[0].model_copy(update={"duration_s": 10.0})
    changed = {"rate_hz": config.rate_hz / 2.0, "settle_s": 2.0, "cases": (half,)}
    return config.model_copy(update=changed)


def whole(config: ExperimentConfig) -> ExperimentConfig:
    """Return the experiment itself."""
    return config


@pytest.mark.parametrize(
    ("part", "seed"),
    [(brief, 1), *(pytest.param(whole, seed, marks=pytest.mark.stress) for seed in range(1, 12))],
)
def test_errors_are_below_those_of_the_paper(
    part: Callable[[ExperimentConfig], ExperimentConfig], seed: int
) -> None:
    """Tracking and nonlinearity in every case; adaptive is below feedforward."""
    config = part(load_experiment(QIU, registry)).model_copy(update={"seed": seed})
    result = run_experiment(config, "", "qiu", lambda _label, _share: None)
    runs: dict[tuple[str, str], Recording] = {(r.case, r.mode): r for r in result.recordings}

    assert len(runs) == 3 * len(config.cases)
    for case in result.cases:
        without = runs[case, Mode.UNCOMPENSATED].metrics
        assert without["nonlinearity_pct"] >= 6.0
        for metric in ("nonlinearity_pct", "tracking_max_pct"):
            feedforward = runs[case, Mode.FEEDFORWARD].metrics[metric]
            adaptive = runs[case, Mode.ADAPTIVE].metrics[metric]
            assert feedforward <= PAPER_PCT[case, Mode.FEEDFORWARD]
            assert adaptive <= PAPER_PCT[case, Mode.ADAPTIVE]
            assert adaptive < feedforward


def test_file_has_the_errors_of_the_paper() -> None:
    """The report compares with the errors in the paper."""
    config = load_experiment(QIU, registry)
    named = {
        (case.name, mode): value
        for case in config.cases
        for mode, value in case.reference_pct.items()
    }

    assert named == PAPER_PCT
    assert config.reference == "paper"
