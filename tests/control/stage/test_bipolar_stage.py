"""Tests of a running stage that rests inside its range, beside its unipolar twin."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from piezod.config.model_file import ModelFile, dump_model
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import opened
from piezod.messages import requests as rq
from tests.conftest import Figure
from tests.control.make_models import as_file
from tests.control.rig_stage import RigStage, quick_config, with_axis
from tests.experiment.twins import BIPOLAR, RATE_HZ, UNIPOLAR, twin

RANGE_UM = 12.0
SINE = Sine(kind="sine", low=0.0, high=RANGE_UM, frequency_hz=1.0)


@cache
def model_of(low_v: float, high_v: float) -> ModelFile:
    """Return the model of a twin."""
    config = twin(low_v, high_v)
    with opened(config, lambda _further_s: None) as stage:
        return as_file(identify_axes(stage, config)["x"].model)


def stage_of(range_v: tuple[float, float], folder: Path) -> RigStage:
    """Return the running stage of a twin, zeroed and conditioned as a person would do it."""
    path, experiment = folder / f"{range_v[0]:g}.yaml", twin(*range_v)
    path.write_text(dump_model(model_of(*range_v)), encoding="utf-8")
    axis = experiment.axes["x"]
    config = with_axis(
        quick_config(),
        model=path,
        limits=axis.limits,
        command_range_um=(0.0, 15.0),
        compensator=axis.compensator,
    )
    config = config.model_copy(update={"devices": experiment.devices, "rate_hz": RATE_HZ})
    stage = RigStage(config)
    stage.until("SAFE")
    zero(stage)
    stage.do(rq.Arm())
    condition(stage)
    return stage


def zero(stage: RigStage) -> None:
    """Zero the sensor at rest."""
    stage.do(rq.Zero())
    stage.run(0.4)


def condition(stage: RigStage) -> None:
    """Condition the stage, and zero what that makes necessary."""
    stage.do(rq.Condition())
    stage.until("READY")
    stage.run(0.4)


def error_pct(stage: RigStage, mode: Mode = Mode.FEEDFORWARD) -> float:
    """Return the rms error of the measured position in a sine from rest, in % of its range."""
    stage.do(rq.SelectMode(mode=mode))
    stage.do(rq.Wave(command_um={"x": SINE}, duration_s=3.0))
    records = [record.axes[0] for record in stage.run(3.0)][-int(2.0 * RATE_HZ) :]
    errors_um = np.array([each.position_um - each.command_um for each in records])
    return 100.0 / RANGE_UM * float(np.sqrt(np.mean(errors_um**2)))


def disarmed(stage: RigStage) -> None:
    """Disarm and zero the stage, and arm it again."""
    stage.do(rq.Disarm())
    stage.until("SAFE")
    zero(stage)
    stage.do(rq.Arm())


def adopted(stage: RigStage, range_v: tuple[float, float]) -> None:
    """Change over to the model anew, as after another identification."""
    stage.do(rq.Disarm())
    stage.until("SAFE")
    stage.do(rq.AdoptModel(model=model_of(*range_v)), rq.Arm())
    condition(stage)


@pytest.mark.stress
def test_bipolar_stage_follows_as_its_unipolar_twin(tmp_path: Path, figure: Figure) -> None:
    """After conditioning, again and again, after `disarm`, in each mode, with another model."""
    table: list[list[float]] = []
    for range_v in (UNIPOLAR, BIPOLAR):
        stage = stage_of(range_v, tmp_path)
        errors_pct = [error_pct(stage), error_pct(stage)]
        disarmed(stage)
        errors_pct.append(error_pct(stage))
        errors_pct += [error_pct(stage, mode) for mode in (Mode.ADAPTIVE, Mode.TRIMMED)]
        errors_pct.append(error_pct(stage))
        adopted(stage, range_v)
        errors_pct.append(error_pct(stage))
        table.append(errors_pct)

    figure(f"rms %: unipolar {np.round(table[0], 3)}, bipolar {np.round(table[1], 3)}")
    assert max(table[1]) < 1.3 * max(table[0]) + 0.05


def test_bipolar_stage_keeps_to_its_zero(tmp_path: Path) -> None:
    """Wherever its voltage has been, it follows a command from the zero where it rests."""
    stage = stage_of(BIPOLAR, tmp_path)
    conditioned_pct = error_pct(stage)
    disarmed(stage)

    assert max(conditioned_pct, error_pct(stage)) < 0.5


def test_bipolar_stage_is_not_relaxed_by_itself(tmp_path: Path) -> None:
    """Its hysteresis is not known before it is conditioned, whatever its devices say."""
    path = tmp_path / "model.yaml"
    path.write_text(dump_model(model_of(*BIPOLAR)), encoding="utf-8")
    axis = twin(*BIPOLAR).axes["x"]
    config = with_axis(quick_config(), model=path, limits=axis.limits, command_range_um=None)
    stage = RigStage(config, memory_known=True).armed()

    answer = stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE))

    assert not answer.accepted
    assert "condition" in answer.why
