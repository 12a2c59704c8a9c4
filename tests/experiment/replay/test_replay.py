"""A recording again in virtual time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezod.config.modes import Mode
from piezod.control.law.creep import NO_CREEP
from piezod.control.law.model import StageModel
from piezod.control.law.model_files import read_model
from piezod.errors import DataError
from piezod.experiment.replay.comparison import Comparison, replay_recording
from piezod.experiment.replay.stand_in import StandIn
from piezod.records.recording.columns import FORMS
from piezod.records.recording.reader import read_telemetry
from tests.control.rig_stage import shipped_config
from tests.recorded import RATE_HZ, new_stage, run_modes, write_recording

ALL = tuple(Mode)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of the same sine in all modes, with a skipped period in each."""
    path = tmp_path_factory.mktemp("recorded") / "rec.h5"
    stage = new_stage()
    run_modes(stage, ALL)
    write_recording(path, stage)
    return path


def shipped_model() -> StageModel:
    """Return the model of the recorded stage."""
    path = shipped_config().axes["x"].model
    assert path is not None
    return read_model(path)[0]


def replayed(path: Path, mode: Mode | None = None, model: StageModel | None = None) -> Comparison:
    """Replay a recording with the model of the stage, or another one."""
    config = shipped_config().axes["x"]
    used = model or shipped_model()
    telemetry = read_telemetry(path)
    return replay_recording(path, telemetry, "x", config, used, mode=mode, learned=model is None)


def test_same_model_repeats_the_recording(recording: Path) -> None:
    """In all modes, also where it learned, to some mV; an error is command minus position."""
    compared = replayed(recording)

    assert compared.repeats
    found = compared.replay
    below = found.recorded.position_um < found.recorded.command_um
    assert np.array_equal(below, found.recorded_error_um > 0.0)
    assert np.array_equal(found.position_um < found.recorded.command_um, found.error_um > 0.0)
    assert [row.recorded for row in compared.rows] == [mode.value for mode in ALL]
    for row in compared.rows:
        assert row.drive_rms_v < 0.05
        assert row.rms_um == pytest.approx(row.recorded_rms_um, abs=0.002)


def test_other_drive_is_not_repeated(tmp_path: Path) -> None:
    """A recording of another law, here of another trim, is not repeated, and the replay says so."""
    axis = shipped_config().axes["x"]
    other = axis.model_copy(update={"trim": axis.trim.model_copy(update={"gain_per_s": 5.0})})
    stage = new_stage(axis=other)
    run_modes(stage, (Mode.UNCOMPENSATED, Mode.TRIMMED))
    write_recording(tmp_path / "other.h5", stage)

    assert not replayed(tmp_path / "other.h5").repeats


@pytest.mark.parametrize(("form", "repeats"), [("stops", False), ("surface", True)])
def test_weights_of_another_form_are_not_used(tmp_path: Path, form: str, repeats: bool) -> None:
    """A model of stops starts with recorded weights of stops, not with those of a surface."""
    stage = new_stage()
    run_modes(stage, (Mode.ADAPTIVE,))
    write_recording(tmp_path / "rec.h5", stage)
    telemetry, model = read_telemetry(tmp_path / "rec.h5"), shipped_model()
    telemetry.weights["x"] = {
        "weights": 0.5 * model.weights[np.newaxis],
        "weights_t_s": np.zeros(1),
        "weights_form": np.array([FORMS[form]]),
    }

    axis = shipped_config().axes["x"]
    found = replay_recording(
        tmp_path / "rec.h5", telemetry, "x", axis, model, mode=Mode.ADAPTIVE, learned=True
    )

    assert found.repeats == repeats


@pytest.mark.parametrize("mode", [Mode.FEEDFORWARD, Mode.TRIMMED, Mode.CLOSED])
@pytest.mark.few(1)
def test_estimate_for_another_mode_is_what_that_mode_reached(recording: Path, mode: Mode) -> None:
    """From the uncompensated part, the errors of other modes are estimated as they were there."""
    uncompensated, *others = replayed(recording, mode).rows
    (reached,) = [row for row in others if row.recorded == mode.value]

    assert uncompensated.recorded_rms_um > 1.2
    # The sine in the real mode: the same, from another hysteresis memory, with other noise.
    assert uncompensated.rms_um == pytest.approx(reached.recorded_rms_um, abs=0.04)


def test_worse_model_is_told_apart(recording: Path) -> None:
    """A model almost without hysteresis is as bad as no compensation; the right one is better."""
    shipped = shipped_model()
    line = StageModel(
        shipped.form,
        0.01 * shipped.weights,  # not 0: an axis without weights adopts learned ones
        shipped.drive_v,
        shipped.position_um,
        shipped.delay_s,
    )
    worse = replayed(recording, Mode.FEEDFORWARD, line)
    rows = {row.recorded: row for row in worse.rows}
    better = {row.recorded: row for row in replayed(recording, Mode.FEEDFORWARD).rows}

    assert worse.stand_in == "fitted"
    assert worse.stand_in_um < 0.1
    assert rows["feedforward"].rms_um > 1.0
    assert better["feedforward"].rms_um < 0.12
    assert rows["feedforward"].rms_um == pytest.approx(
        rows["uncompensated"].recorded_rms_um, rel=0.25
    )


def test_stand_in_at_the_recorded_voltage_is_the_record() -> None:
    """At the same voltages nothing is added, whatever the delay; at others what the model says."""
    model = shipped_model()
    drive_v = 50.0 - 50.0 * np.cos(np.linspace(0.0, 12.0, 400))
    stage = StandIn(model, drive_v, 1.0 / RATE_HZ)
    same = [stage.moved_um(k, float(voltage_v)) for k, voltage_v in enumerate(drive_v)]
    higher = StandIn(model, drive_v, 1.0 / RATE_HZ)
    moved = [higher.moved_um(k, float(voltage_v) + 5.0) for k, voltage_v in enumerate(drive_v)]

    assert np.max(np.abs(same)) < 1e-9
    slope_um_per_v = model.position_um.width / model.drive_v.width
    assert np.mean(moved) == pytest.approx(5.0 * slope_um_per_v, rel=0.3)


def test_stand_in_creeps_after_a_voltage_that_was_not_recorded() -> None:
    """A step that the stage did not make creeps on in the estimate, as the model says."""
    model = shipped_model()
    drive_v = np.full(2000, 50.0)
    stage = StandIn(model, drive_v, 1.0 / RATE_HZ)
    moved_um = [stage.moved_um(k, 60.0) for k in range(drive_v.size)]
    still = StandIn(replace(model, creep=NO_CREEP), drive_v, 1.0 / RATE_HZ)
    still_um = [still.moved_um(k, 60.0) for k in range(drive_v.size)]

    passed_s = (drive_v.size - 1) / RATE_HZ
    shares = model.creep.weights * -np.expm1(-passed_s / model.creep.time_constants_s)
    assert moved_um[-1] / still_um[-1] == pytest.approx(1.0 + np.sum(shares), rel=1e-3)


def test_recording_without_a_command_is_refused(tmp_path: Path) -> None:
    """Nothing can be compared in a recording in which the stage never runs."""
    stage = new_stage()
    stage.run(0.2)
    write_recording(tmp_path / "safe.h5", stage)

    with pytest.raises(DataError, match="axis x follows no command in this recording"):
        replayed(tmp_path / "safe.h5")


def test_unknown_memory_is_told(recording: Path) -> None:
    """A part that does not start at rest gives a warning."""
    config, telemetry = shipped_config().axes["x"], read_telemetry(recording, 2.2, 3.5)
    compared = replay_recording(recording, telemetry, "x", config, shipped_model(), learned=True)

    assert any("not at rest" in warning for warning in compared.warnings)
