"""Tests of the experiment whose drive has all excitation."""

from pathlib import Path

import pytest

from piezod.config.experiment import load_experiment
from piezod.config.modes import Mode
from piezod.config.yaml_loader import parse_yaml
from piezod.devices import registry
from piezod.experiment.fit.excitation import recommended_drive
from piezod.experiment.virtual.run import run_experiment
from tests.conftest import Figure

IDENTIFY = Path(__file__).parents[3] / "config" / "experiments" / "identify.yaml"


def test_drive_is_the_recommended_one() -> None:
    """The file has the recommended drive, and the rig of the experiment beyond the paper."""
    config, beyond = (
        load_experiment(path, registry) for path in (IDENTIFY, IDENTIFY.with_name("beyond.yaml"))
    )
    recommended = parse_yaml(recommended_drive(0.0, 148.0), "recommended").data["identification"]

    assert config.identification is not None
    assert config.identification == type(config.identification).model_validate(recommended)
    assert (config.devices, config.seed) == (beyond.devices, beyond.seed)
    assert config.modes == (Mode.FEEDFORWARD,)


@pytest.mark.stress
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_model_reaches_the_target(seed: int, figure: Figure) -> None:
    """The true error is within the target of the file for any such stack."""
    config = load_experiment(IDENTIFY, registry).model_copy(update={"seed": seed})
    (case,) = config.cases

    result = run_experiment(config, "", "", lambda _label, _share: None)

    (recording,) = result.recordings
    metrics = recording.metrics
    worst = max(metrics["true_tracking_max_pct"], metrics["true_nonlinearity_pct"])
    figure(f"identify.yaml, seed {seed}: worst true error of feedforward {worst:.2f} %")
    assert worst <= case.reference_pct[Mode.FEEDFORWARD]
    assert result.warnings == ()
