"""A stage whose model is a surface: adopted while it runs, learned, recorded and replayed."""

from pathlib import Path

import numpy as np
import pytest

from piezod.config.axes import CompensatorConfig
from piezod.config.modes import Mode
from piezod.control.law.model_files import read_model
from piezod.experiment.replay.comparison import replay_recording
from piezod.hysteresis.everett_bounds import least_surface_slope
from piezod.messages import requests as rq
from piezod.records.figures.run import mode_figure
from piezod.records.recording.reader import read_telemetry
from tests.control.rig_stage import RigStage, quick_config, shipped_config, with_axis
from tests.control.surface_rig import surface_file, with_model
from tests.recorded import new_stage, run_modes, sine, write_recording


def adopting(stage: RigStage) -> RigStage:
    """Adopt the surface in SAFE."""
    stage.until("SAFE")
    answer = stage.ask(rq.AdoptModel(axis="x", model=surface_file()))
    assert (answer.accepted, answer.why) == (True, "")
    return stage


def worst_error_um(stage: RigStage, mode: Mode) -> float:
    """Follow a sine; return the worst measured error of its second half, in µm."""
    stage.do(rq.SelectMode(mode=mode), sine(3.0, 23.0, 1.0, 4.0))
    records = stage.run(3.9)[-900:]
    return max(abs(each.axes[0].position_um - each.axes[0].command_um) for each in records)


def test_surface_is_adopted_and_learned() -> None:
    """The running stage changes over to a surface, follows with it, and learns its coefficients."""
    before = RigStage(shipped_config().model_copy(update={"rate_hz": 500.0}))
    was_surface = before.controller.learned(0).surface
    stage = adopting(before)
    stage.do(rq.Arm())
    law = stage.stage.axes[0].law
    start = law.compensator.weights.copy()

    fixed_um = worst_error_um(stage, Mode.FEEDFORWARD)
    learned_um = worst_error_um(stage, Mode.ADAPTIVE)

    assert (was_surface, stage.controller.learned(0).surface) == (False, True)
    assert start.tolist() == list(surface_file().surface_coefficients)
    assert not stage.faults()
    assert learned_um < 0.3
    assert fixed_um < 1.0
    assert np.max(np.abs(law.compensator.weights - start)) > 1e-4
    assert least_surface_slope(law.compensator.weights) > 0.0


@pytest.mark.fault("S9")
@pytest.mark.parametrize("model", ["surface", "path"])
def test_conditioned_stage_is_where_its_model_allows(model: str) -> None:
    """At an end of its range it rests where wide loops end, also if it relaxes along the path."""
    config = with_model(shipped_config().model_copy(update={"rate_hz": 200.0}), model)
    swing = config.axes["x"].conditioning.model_copy(update={"frequency_hz": 5.0})
    stage = RigStage(with_axis(config, conditioning=swing)).armed(rq.Condition())
    stage.until("READY")
    stage.run(1.0)
    rest_um = stage.x.position_um
    stage.do(rq.SelectMode(mode=Mode.ADAPTIVE), rq.Goto(position_um=12.0))
    stage.run(1.0)

    assert stage.faults() == []
    assert rest_um == pytest.approx(0.0, abs=0.3)
    assert stage.x.position_um == pytest.approx(12.0, abs=0.1)


@pytest.mark.parametrize("model", ["surface", "path"])
def test_rest_that_becomes_known_is_zeroed(model: str) -> None:
    """A sensor that was zeroed after an unknown path would err by what this path has left."""
    stage = RigStage(with_model(quick_config(), model), memory_known=False)
    stage.until("SAFE")
    stage.do(rq.Zero())
    stage.run(0.3)

    stage.do(rq.Arm(), rq.Condition())
    stage.until("READY")
    stage.run(0.5)
    rest_um = stage.x.position_um
    stage.do(rq.SelectMode(mode=Mode.FEEDFORWARD), rq.Goto(position_um=12.0))
    stage.run(1.0)

    zeroed = [event for event in stage.events if event.kind == "zero"]
    assert stage.faults() == ["D10"]  # the large change of the zero is no jump
    assert len(zeroed) == (2 if model == "path" else 1)
    assert rest_um == pytest.approx(0.0, abs=0.3)
    assert stage.x.position_um == pytest.approx(12.0, abs=0.3)


def test_surface_needs_recursive_least_squares() -> None:
    """LMS learns weights of stops; the answer names the identifier to use."""
    config = shipped_config()
    settings = CompensatorConfig.model_validate({"identifier": "nlms"})
    blank = with_axis(config, compensator=settings, model=None)
    stage = RigStage(blank.model_copy(update={"rate_hz": 500.0, "mode": "feedforward"}))
    stage.until("SAFE")

    answer = stage.ask(rq.AdoptModel(axis="x", model=surface_file()))

    assert not answer.accepted
    assert "the model is a surface: use `identifier: rls`" in answer.why


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the recording of a stage with a surface, with its coefficients."""
    folder = tmp_path_factory.mktemp("surface")
    axis = with_model(shipped_config(), "surface").axes["x"]
    stage = new_stage(axis=axis)
    run_modes(stage, (Mode.FEEDFORWARD, Mode.ADAPTIVE))
    path = folder / "rec.h5"
    write_recording(path, stage, surface_file().surface_coefficients)
    return path


def test_recording_of_a_surface_is_replayed(recording: Path) -> None:
    """Its own model repeats the drive; with the learned part of it to some mV."""
    axis = with_model(shipped_config(), "surface").axes["x"]
    assert axis.model is not None
    model, _ = read_model(axis.model)

    compared = replay_recording(
        recording, read_telemetry(recording), "x", axis, model, learned=True
    )

    assert compared.repeats
    for row in compared.rows:
        assert row.drive_rms_v < 0.05


def test_recording_of_a_surface_labels_its_coefficients(recording: Path) -> None:
    """24 coefficients are not taken for 12 stops on each side."""
    (read,) = read_telemetry(recording).recordings()
    panel = next(
        each for each in mode_figure(read).axes if each.get_title(loc="left").startswith("(e)")
    )

    assert read.surface
    assert read.weights[0].tolist() == list(surface_file().surface_coefficients)
    legend = panel.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["c0 to c23"]
    assert "c0" in {text.get_text() for text in panel.texts}
