"""Tests of runs in virtual time whose loop oscillates: they end, and say why."""

from pathlib import Path

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.first_mode import FirstModeConfig
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.errors import ModelError
from piezod.experiment.check_file import check_file
from piezod.experiment.virtual.run import run_experiment
from tests.experiment.beyond import EXPERIMENTS, experiment_of

MODEL = EXPERIMENTS.parent / "models" / "simulated-stack.yaml"
SHARP = FirstModeConfig(frequency_hz=400.0, damping=0.005)
FAST_SENSOR = {"bandwidth_hz": 10_000, "antialias_hz": 4000, "delay_s": 0.00011}
"""A slow filter would turn the phase of the mode so that the loop damps it."""


def experiment(mode: Mode, told: FirstModeConfig | None, hz: float = 0.5) -> ExperimentConfig:
    """Return a second of a sine on a stage with a sharp mode at 400 Hz."""
    config = experiment_of("light-damping", sensor=FAST_SENSOR)
    axis = config.axes["x"].model_copy(update={"first_mode": told, "model": MODEL})
    sine = Sine(kind="sine", low=1.0, high=21.0, frequency_hz=hz)
    case = config.cases[0].model_copy(
        update={"command_um": sine, "duration_s": 2.5, "period_s": 1.0 / hz}
    )
    return config.model_copy(
        update={
            "axes": {"x": axis},
            "identification": None,
            "settle_s": 0.5,
            "modes": (mode,),
            "cases": (case,),
        }
    )


def run(config: ExperimentConfig) -> float:
    """Run an experiment; return its worst true error, in %."""
    (recording,) = run_experiment(config, "", "", lambda _label, _share: None).recordings
    return recording.metrics["true_tracking_max_pct"]


@pytest.mark.fault("D6")
@pytest.mark.parametrize("hz", [0.5, 5.0])
def test_untold_mode_ends_a_trimmed_run(hz: float) -> None:
    """The text names the case, the mode, the axis, and what to do."""
    with pytest.raises(ModelError, match=r"case 1, trimmed: axis x oscillates .*piezod response"):
        run(experiment(Mode.TRIMMED, None, hz))


@pytest.mark.parametrize("mode", [Mode.TRIMMED, Mode.CLOSED])
def test_told_mode_does_not_ring(mode: Mode) -> None:
    """The gains follow from it."""
    assert run(experiment(mode, SHARP)) < 5.0


def test_open_loop_is_not_watched() -> None:
    """Nothing feeds an oscillation in feedforward."""
    assert run(experiment(Mode.FEEDFORWARD, None)) < 10.0


def test_check_warns_of_an_untold_mode(tmp_path: Path) -> None:
    """It names the modes that may oscillate, and up to which frequency."""
    text = (EXPERIMENTS / "beyond.yaml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if "first_mode:" not in line]
    path = tmp_path / "untold.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")

    (warning,) = check_file(path).warnings

    assert "in `trimmed` below 8e+02 Hz" in warning
