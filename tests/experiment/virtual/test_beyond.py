"""Tests of the targets beyond the paper, for the true displacement on any stage."""

from pathlib import Path

import pytest

from piezod.config.experiment import load_experiment
from piezod.config.modes import Mode
from piezod.devices import registry
from piezod.experiment.virtual.run import run_experiment
from piezod.records.recording import Recording
from tests.conftest import Figure

EXPERIMENTS = Path(__file__).parents[3] / "config" / "experiments"

TARGETS_PCT = {Mode.FEEDFORWARD: 0.9, Mode.ADAPTIVE: 0.4, Mode.TRIMMED: 0.2}
WITHIN_PCT = {**TARGETS_PCT, Mode.TRIMMED: 0.26}
"""Targets. A trim follows its sensor, whose calibration error of 0.05 % of the travel is up to 0.17
% of the range of a case on some stages: there the target is missed."""
TRUE = ("true_tracking_max_pct", "true_nonlinearity_pct")
SHOWN = (*TRUE, "tracking_max_pct", "nonlinearity_pct", "noise_rms_pct")

SEEDS = [(1, 1), *(pytest.param(seed, 3, marks=pytest.mark.stress) for seed in range(1, 12))]
"""Seeds and numbers of cases."""


def run(name: str, seed: int, n_cases: int = 3) -> dict[tuple[str, str], Recording]:
    """Run the first cases of an experiment; return its recordings by case and mode."""
    config = load_experiment(EXPERIMENTS / name, registry)
    config = config.model_copy(update={"seed": seed, "cases": config.cases[:n_cases]})
    result = run_experiment(config, "", name, lambda _label, _share: None)
    return {(r.case, r.mode): r for r in result.recordings}


def worst_of(runs: dict[tuple[str, str], Recording], mode: Mode) -> str:
    """Return the worst errors of a mode over the cases, as text."""
    metrics = [recording.metrics for (_, of), recording in runs.items() if of == mode]
    numbers = " / ".join(f"{max(m[name] for m in metrics):.2f}" for name in SHOWN)
    return f"{mode} {numbers}"


@pytest.mark.parametrize(("seed", "n_cases"), SEEDS)
def test_true_errors_are_small(seed: int, n_cases: int, figure: Figure) -> None:
    """Tracking error and nonlinearity of the true displacement, in every case and mode."""
    runs = run("beyond.yaml", seed, n_cases)
    shown = ", ".join(worst_of(runs, mode) for mode in TARGETS_PCT)
    figure(f"beyond.yaml, seed {seed:2}, true worst / nonlinearity, measured, noise: {shown} %")
    errors_pct = {
        (case, mode, metric): recording.metrics[metric]
        for (case, mode), recording in runs.items()
        for metric in TRUE
        if mode in TARGETS_PCT
    }

    assert len(errors_pct) == 6 * n_cases
    assert {
        key: error for key, error in errors_pct.items() if not error <= WITHIN_PCT[Mode(key[1])]
    } == {}


@pytest.mark.stress
@pytest.mark.parametrize("name", ["beyond-afm.yaml", "beyond-flexure.yaml"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_adaptive_halves_the_errors_of_other_stages(name: str, seed: int, figure: Figure) -> None:
    """On a skewed scanner and on a drifting stage adaptive has at most half the error."""
    runs = run(name, seed)
    shown = ", ".join(worst_of(runs, mode) for mode in TARGETS_PCT)
    figure(f"{name}, seed {seed}, true worst / nonlinearity, measured, noise: {shown} %")
    for case in {case for case, _ in runs}:
        for metric in TRUE:
            feedforward = runs[case, Mode.FEEDFORWARD].metrics[metric]
            assert runs[case, Mode.ADAPTIVE].metrics[metric] <= 0.5 * feedforward


def test_file_has_the_targets() -> None:
    """The report compares with the targets of this test."""
    config = load_experiment(EXPERIMENTS / "beyond.yaml", registry)

    assert all(case.reference_pct == TARGETS_PCT for case in config.cases)
