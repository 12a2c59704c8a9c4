"""Tests of the targets beyond the paper, for the true displacement on stages of many classes."""

from collections.abc import Sequence
from typing import NamedTuple

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.experiment.virtual.run import run_experiment
from piezod.plant.variants import VARIANTS
from tests.conftest import Figure
from tests.experiment.beyond import FOREIGN, LIMITS, Limit, brief, experiment_of

TARGETS_PCT = {Mode.FEEDFORWARD: 0.5, Mode.ADAPTIVE: 0.25, Mode.TRIMMED: 0.15}
MODES = tuple(TARGETS_PCT)
TRUE = ("true_tracking_max_pct", "true_nonlinearity_pct")
SHOWN = (*TRUE, "tracking_max_pct", "nonlinearity_pct", "noise_rms_pct")


class Bounds(NamedTuple):
    """Largest worst true error of the modes, in %, and the reason if they are above the targets."""

    feedforward: float
    adaptive: float
    trimmed: float
    reason: str


REGULAR = Bounds(
    0.5,
    0.25,
    0.23,
    "a trim follows its sensor, whose calibration error of 0.05 % of the travel is up to 0.17 % "
    "of the range of a case",
)
BOUNDS = {
    **dict.fromkeys(VARIANTS, REGULAR),
    "thermal-relays": Bounds(
        1.0, 0.3, 0.3, "loops widen with the speed; the model has one lag for loops of all sizes"
    ),
    "flexure": Bounds(2.3, 0.3, 0.3, "the return point drifts by 3.7 % of the travel"),
    "no-antialias": Bounds(
        0.5, 0.5, 0.42, "noise and the ripple of the mode are aliased into the samples"
    ),
    "bouc-wen": Bounds(0.6, 0.25, 0.25, "its rest depends on the path"),
    "dahl": Bounds(1.0, 0.25, 0.25, "its state relaxes by another equation than the model's"),
    "gain-drift": Bounds(4.6, 0.25, 0.33, "the gain grows by 4 % within the experiment"),
    "stack-uncalibrated": Bounds(
        1.9, 1.8, 1.8, "the sensor is wrong by more than 1 %, and everything follows it"
    ),
}

NOT_LIFTED = ("half the Bouc-Wen part", "exponent 2")
"""What makes an error smaller or larger, and is not enough for the targets."""

LONG = [
    pytest.param(variant, seed, marks=pytest.mark.stress)
    for variant in VARIANTS
    if variant not in FOREIGN  # no target is promised for them: `benchmarks.variants --foreign`
    for seed in range(1, 6)
]


def worst_pct(config: ExperimentConfig) -> dict[Mode, dict[str, float]]:
    """Run an experiment; return the largest error of its cases by mode and metric, in %."""
    config = config.model_copy(update={"modes": MODES})
    result = run_experiment(config, "", config.title, lambda _label, _share: None)
    assert len(result.recordings) == len(MODES) * len(config.cases)
    return {
        mode: {
            name: max(r.metrics[name] for r in result.recordings if r.mode == mode)
            for name in SHOWN
        }
        for mode in MODES
    }


def shown(worst: dict[Mode, dict[str, float]]) -> str:
    """Return the worst errors as text."""
    return ", ".join(
        f"{mode} {' / '.join(f'{errors[name]:.2f}' for name in SHOWN)}"
        for mode, errors in worst.items()
    )


def misses(worst: dict[Mode, dict[str, float]], bounds: Sequence[float]) -> dict[str, float]:
    """Return the true errors above the bounds of their mode."""
    return {
        f"{mode} {metric}": worst[mode][metric]
        for mode, bound in zip(MODES, bounds, strict=True)
        for metric in TRUE
        if not worst[mode][metric] <= bound
    }


@pytest.mark.parametrize(
    "variant",
    ["preisach-asymmetric", pytest.param("thermal-relays", marks=pytest.mark.stress)],
)
def test_true_errors_are_small(variant: str, figure: Figure) -> None:
    """One case, after half of the identification, is within the bounds of the variant."""
    worst = worst_pct(brief(experiment_of(variant)))
    figure(f"{variant}, one case, true worst / nonlinearity, measured, noise: {shown(worst)} %")

    assert misses(worst, BOUNDS[variant][:3]) == {}


@pytest.mark.parametrize(("variant", "seed"), LONG)
def test_true_errors_are_small_on_any_stage(variant: str, seed: int, figure: Figure) -> None:
    """Tracking error and nonlinearity of the true displacement, in every case and mode."""
    worst = worst_pct(experiment_of(variant, seed))
    figure(f"{variant}, seed {seed}, true worst / nonlinearity, measured, noise: {shown(worst)} %")

    assert misses(worst, BOUNDS[variant][:3]) == {}


def test_file_has_the_targets() -> None:
    """The report compares with the targets of this test."""
    assert all(case.reference_pct == TARGETS_PCT for case in experiment_of("stack").cases)


REACHED = Bounds(0.5, 0.25, 0.23, "")
EXACT = Bounds(0.5, 0.25, 0.15, "")
LIMITED_BY = [
    pytest.param(limit, EXACT if "exact" in limit.lifted else REACHED, id=" ".join(limit[:2]))
    for limit in LIMITS
    if limit.lifted not in NOT_LIFTED
]


@pytest.mark.stress
@pytest.mark.parametrize(("limit", "bounds"), LIMITED_BY)
def test_errors_are_due_to_these_effects(limit: Limit, bounds: Bounds, figure: Figure) -> None:
    """Without the effects that limit it, a variant reaches the targets."""
    worst = worst_pct(experiment_of(limit.variant, **limit.rig))
    figure(f"{limit.variant}, {limit.lifted}, true worst / nonlinearity …: {shown(worst)} %")

    assert misses(worst, bounds[:3]) == {}


@pytest.mark.stress
def test_adaptive_follows_a_drifting_gain(figure: Figure) -> None:
    """While the gain grows by 10 % in 600 s, the true error stays below 0.4 %.

    The command stays 1 µm above rest: creep and drift of this time would need negative voltages.
    """
    config = experiment_of("gain-drift")
    command = config.cases[0].command_um
    assert isinstance(command, Sine)
    above = command.model_copy(update={"low": 1.0})
    long = config.cases[0].model_copy(update={"duration_s": 600.0, "command_um": above})
    config = config.model_copy(update={"cases": (long,), "modes": (Mode.ADAPTIVE,)})
    (recording,) = run_experiment(config, "", "", lambda _label, _share: None).recordings
    worst = max(recording.metrics[metric] for metric in TRUE)
    figure(f"gain-drift, 600 s, adaptive: worst true error {worst:.2f} %")

    assert worst <= 0.4
