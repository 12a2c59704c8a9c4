"""The model that stands in for the stage of a recording."""

from pathlib import Path

import pytest

from piezod.config.daemon import StageAxisConfig
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.law.model_files import read_model
from piezod.experiment.replay.comparison import ModeRow, replay_recording
from piezod.messages import requests
from piezod.records.recording.reader import read_telemetry
from tests.control.rig_stage import shipped_config
from tests.recorded import new_stage, sine, write_recording

MODEL = Path(__file__).with_name("bouc-wen.yaml")
"""Identified from the stage below, driven as in config/experiments/beyond.yaml."""


def recorded(path: Path, mode: Mode, model: Path | None) -> StageAxisConfig:
    """Record sines of two sizes on a Bouc-Wen stage; return its axis.

    Args:
        path: The recording.
        mode: Mode of the stage.
        model: Its model; that of another stage if None.
    """
    axis = shipped_config().axes["x"]
    if model:
        axis = axis.model_copy(update={"model": model})
    stage = new_stage(axis, "bouc-wen")
    stage.do(requests.Arm(), requests.SelectMode(mode=mode))
    for low_um, high_um in ((2.0, 22.0), (8.0, 14.0)):
        stage.do(sine(low_um, high_um, 2.0, 1.0))
        stage.run(1.1)
    stage.do(requests.Stop())
    stage.until(State.SAFE)
    write_recording(path, stage)
    return axis


def replayed(path: Path, axis: StageAxisConfig) -> ModeRow:
    """Replay a recording with the model in feedforward."""
    telemetry = read_telemetry(path)
    used = read_model(MODEL)[0]
    compared = replay_recording(path, telemetry, "x", axis, used, mode=Mode.FEEDFORWARD)
    assert compared.stand_in == "replayed"
    return compared.rows[-1]


def test_model_that_describes_the_stage_better_than_stops_stands_in(tmp_path: Path) -> None:
    """A run without compensation shows, within a tenth, the errors that a model will leave."""
    before, after = tmp_path / "before.h5", tmp_path / "after.h5"
    estimated = replayed(before, recorded(before, Mode.UNCOMPENSATED, None))
    reached = replayed(after, recorded(after, Mode.FEEDFORWARD, MODEL))

    assert estimated.recorded_rms_um > 1.0
    assert estimated.rms_um == pytest.approx(reached.recorded_rms_um, rel=0.1)
    assert estimated.worst_um == pytest.approx(reached.recorded_worst_um, rel=0.1)
