from pathlib import Path

import numpy as np
import pytest

from piezod.config.experiment import load_experiment
from piezod.config.model_file import FitConfig, ModelFile, SourceConfig, dump_model
from piezod.config.modes import Mode
from piezod.devices import registry
from piezod.errors import DataError, DeviceError, ModelError
from piezod.experiment.error_rows import error_rows
from piezod.experiment.outputs import write_outputs
from piezod.experiment.virtual.run import run_experiment
from piezod.experiment.virtual.stage import opened
from piezod.records.experiment_file import read_hdf5
from piezod.records.experiment_result import ExperimentResult
from tests.experiment.conftest import SLOW_LOOP, Load

MODES = (Mode.UNCOMPENSATED, Mode.FEEDFORWARD, Mode.ADAPTIVE)
"""Modes in which cases run if the file names none."""


def run(load: Load, text: str) -> ExperimentResult:
    """Run an experiment from text."""
    return run_experiment(load(text), text, "a test", lambda _label, _share: None)


@pytest.fixture
def short() -> str:
    """Return the text of the short experiment with a slow loop."""
    return SLOW_LOOP


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> ExperimentResult:
    """Return the result of the short experiment; no test changes it."""
    path = tmp_path_factory.mktemp("short") / "experiment.yaml"
    path.write_text(SLOW_LOOP, encoding="utf-8")
    return run(lambda _text: load_experiment(path, registry), SLOW_LOOP)


def test_every_case_runs_in_every_mode(result: ExperimentResult) -> None:
    """There is one row per run, in the order of the runs."""
    rows = error_rows(result)

    assert [(row["case"], row["mode"]) for row in rows] == [("slow", mode) for mode in MODES]
    assert set(rows[0]) == {
        "axis",
        "case",
        "mode",
        "tracking_max_pct",
        "tracking_rms_pct",
        "nonlinearity_pct",
    }


def test_compensation_removes_most_of_the_hysteresis(result: ExperimentResult) -> None:
    """Both compensated modes have less than a third of the uncompensated error."""
    without, feedforward, adaptive = (r.metrics for r in result.recordings)

    assert without["nonlinearity_pct"] > 6.0
    assert feedforward["nonlinearity_pct"] < without["nonlinearity_pct"] / 3
    assert adaptive["nonlinearity_pct"] < without["nonlinearity_pct"] / 3


def test_same_seed_gives_the_same_experiment_to_the_bit(
    load: Load, short: str, result: ExperimentResult
) -> None:
    """All data, errors and parameters are equal."""
    assert run(load, short) == result


def test_another_seed_is_another_stage(load: Load, short: str, result: ExperimentResult) -> None:
    """The displacement differs by more than the noise."""
    one = result.recordings[0]
    other = run(load, short.replace("seed: 3", "seed: 4")).recordings[0]

    assert np.max(np.abs(one.position_um - other.position_um)) > 0.1


def test_command_starts_at_rest_and_drive_stays_within_its_limits(
    result: ExperimentResult,
) -> None:
    """Range and slew rate hold from sample to sample, in every mode."""
    for recording in result.recordings:
        assert recording.drive_v[0] == pytest.approx(0.0, abs=1.0)
        assert recording.command_um[0] == 0.0
        assert 0.0 <= recording.drive_v.min() <= recording.drive_v.max() <= 150.0
        assert np.max(np.abs(np.diff(recording.drive_v))) <= 20.0 + 1e-9


def test_slow_amplifier_never_exceeds_its_slew_rate(load: Load, short: str) -> None:
    """If the command needs more, the drive follows the limit."""
    slow = short.replace("slew_v_per_s: 20000", "slew_v_per_s: 600")
    hurried = slow.replace("high: 20, frequency_hz: 1", "high: 20, frequency_hz: 3")
    recording = run(load, hurried).recordings[1]

    assert np.max(np.abs(np.diff(recording.drive_v))) == pytest.approx(600.0 / 200.0)


def test_true_errors_are_reported_if_requested(load: Load, short: str) -> None:
    """They are of the size of the measured errors, which contain the noise."""
    metrics = "metrics: [tracking_max_pct, true_tracking_max_pct, noise_rms_pct]\n"
    for recording in run(load, short + metrics).recordings:
        measured, true, noise = recording.metrics.values()

        assert np.isfinite(recording.true_um).all()
        assert measured == pytest.approx(true, abs=1.0)
        assert 0.02 < noise < 0.2


def test_parameters_move_in_adaptive_mode_only(result: ExperimentResult) -> None:
    """Each run has its snapshots of the 38 parameters."""
    recordings = {recording.mode: recording for recording in result.recordings}

    assert recordings["feedforward"].weights.shape == (60, 38)
    assert np.ptp(recordings["feedforward"].weights, axis=0).max() == 0.0
    assert np.ptp(recordings["adaptive"].weights, axis=0).max() > 0.0


def model_file(result: ExperimentResult, offset_um: float) -> str:
    """Return the model of a result as a file with another zero."""
    parameters = result.identifications[0].parameters
    drive_v, position_um = parameters["drive_range_v"], parameters["position_range_um"]

    def numbers(name: str) -> tuple[float, ...]:
        return tuple(parameters[name].tolist())

    return dump_model(
        ModelFile(
            created_at="2026-01-01T00:00:00+00:00",
            created_by="a test",
            method="least-squares",
            source=SourceConfig(file="none.csv", sha256="0" * 64),
            fit=FitConfig(voltage_error_max_pct=1.0, voltage_error_rms_pct=0.2),
            drive_low_v=float(drive_v[0]),
            drive_high_v=float(drive_v[1]),
            position_low_um=float(position_um[0]) + offset_um,
            position_high_um=float(position_um[1]) + offset_um,
            delay_s=float(parameters["delay_s"]),
            right_stop_thresholds=numbers("right_stop_thresholds"),
            right_stop_weights=numbers("right_stop_weights"),
            left_stop_thresholds=numbers("left_stop_thresholds"),
            left_stop_weights=numbers("left_stop_weights"),
        )
    )


@pytest.mark.parametrize("offset_um", [0.0, -119.0])
def test_model_with_any_zero_gives_the_same_drive(
    load: Load, short: str, tmp_path: Path, result: ExperimentResult, offset_um: float
) -> None:
    """Commands count from rest, for any zero of the record."""
    (tmp_path / "model.yaml").write_text(model_file(result, offset_um), encoding="utf-8")
    head, tail = short.split("identification:")
    rest = tail[tail.index("settle_s: 0.5\ncases") :]
    from_model = f"{head}    model: model.yaml\n{rest}"
    _, feedforward, _ = run(load, from_model).recordings

    assert feedforward.metrics["tracking_max_pct"] < 3.0


def test_two_axes_follow_two_commands(load: Load, short: str) -> None:
    """Each has its own model, recording and errors."""
    axis = short[short.index("  x:") : short.index("identification:")]
    text = short.replace(axis, axis + axis.replace("  x:", "  y:"))
    text = text.replace(
        "command_um: {kind: sine, low: 0, high: 20, frequency_hz: 1}",
        "command_um: {axes: {x: {kind: sine, low: 0, high: 20, frequency_hz: 1},"
        " y: {kind: triangle, low: 0, high: 18, frequency_hz: 1}}}",
    )
    both = run(load, text)
    x, y = (r for r in both.recordings if r.mode == "adaptive")

    assert (x.axis, y.axis) == ("x", "y")
    assert [i.axis for i in both.identifications] == ["x", "y"]
    assert y.command_um.max() == pytest.approx(18.0, abs=0.1)
    assert y.metrics["tracking_rms_pct"] < 1.0


def test_lms_makes_a_model(load: Load, short: str) -> None:
    """The account of the identification has the method and its errors."""
    (account,) = run(load, short.replace("least-squares", "lms")).identifications

    assert account.method == "lms"
    assert account.fit_errors["voltage_error_rms_pct"] < 2.0


def test_command_beyond_the_identified_range_is_refused(load: Load, short: str) -> None:
    """The error names the case, both ranges and the remedy."""
    with pytest.raises(DataError, match=r"slow commands 0 to 90 µm.*identified from.*larger drive"):
        run(load, short.replace("high: 20", "high: 90"))


def test_unstable_gain_is_refused_before_anything_moves(load: Load, short: str) -> None:
    """The error names the axis and a stable gain."""
    limits = "    limits:"
    greedy = short.replace(limits, f"    compensator: {{lms_gain: 0.5}}\n{limits}")
    seen: list[str] = []
    with pytest.raises(ModelError, match=r"axis x: an LMS gain of 0\.5 is out of range.*0\.169"):
        run_experiment(load(greedy), "", "", lambda label, _share: seen.append(label))

    assert seen == []


def test_saturated_sensor_stops_the_identification(load: Load, short: str) -> None:
    """The error has the number of invalid samples, the first one, and the remedy."""
    saturating = "{variant: stack, sensor: {slope_v_per_um: 1.0}}"
    with pytest.raises(DataError, match=r"samples of the identification were invalid.*range"):
        run(load, short.replace("{variant: stack}", saturating))


def test_devices_are_left_safe_after_an_error(load: Load, short: str) -> None:
    """An error in the middle of a phase closes the devices."""
    config = load(short)
    with pytest.raises(RuntimeError, match="cable"), opened(config, lambda _cycles: None) as stage:
        channels = stage._channels  # noqa: SLF001 - the test checks that they are closed
        raise RuntimeError("cable")

    with pytest.raises(DeviceError, match="not open"):
        channels.capabilities()


def test_rest_goes_to_the_rest_voltage_and_zeroes_the_sensor(load: Load, short: str) -> None:
    """The way from half the range to rest has no step."""
    with opened(load(short), lambda _cycles: None) as stage:
        trace = stage.open_loop([lambda _t_s: 75.0], 0.5)
        assert trace[0, -1, 1] > 5.0
        stage.rest(1.0)
        after = stage.open_loop([lambda _t_s: 0.0], 0.1)

    assert stage.in_force_v == [0.0]
    assert np.abs(after[0, :, 1]).max() < 0.2


@pytest.mark.usefixtures("blank_figures")
def test_written_result_can_be_read(result: ExperimentResult, tmp_path: Path) -> None:
    """The data file contains the whole result, and the report is beside it."""
    report = write_outputs(tmp_path / "new" / "folder", result, None)

    assert read_hdf5(report.parent / "experiment.h5") == result
    assert report.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
