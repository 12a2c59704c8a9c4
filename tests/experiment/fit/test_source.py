"""Tests of the sources of a fit: CSV files, and recordings of running stages."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.config.model_file import load_model
from piezod.config.modes import Mode
from piezod.errors import DataError
from piezod.experiment.fit.file import identify_file
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.source import read_source
from piezod.records.recording.reader import read_telemetry
from tests.experiment.made_up import record_of, write_record
from tests.recorded import new_stage, run_modes, write_recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of a stage that moves over most of its range, with a skipped period."""
    path = tmp_path_factory.mktemp("recorded") / "rec.h5"
    stage = new_stage()
    run_modes(stage, (Mode.UNCOMPENSATED,))
    write_recording(path, stage)
    return path


def rewritten(recording: Path, path: Path, first: int, last: int) -> Path:
    """Write a copy of a recording in which the samples from `first` to `last` are invalid."""
    path.write_bytes(recording.read_bytes())
    with h5py.File(path, "r+") as file:
        file["recording/axis_x/position_um"][first:last] = np.nan
    return path


def test_recording_gives_the_armed_part(recording: Path) -> None:
    """The record pairs each sample with the voltage in force, evenly in time; gaps are told."""
    source = read_source(recording, 0.0)
    telemetry = read_telemetry(recording)
    armed = telemetry.cycles["state"] != telemetry.header.names["state"].index("SAFE")

    missed = int(np.sum(np.diff(telemetry.cycles["skipped"][armed])))
    assert source.record.t_s.size == np.count_nonzero(armed) + missed
    assert np.ptp(np.diff(source.record.t_s)) < 1e-9
    columns = telemetry.axes["x"]
    assert source.record.drive_v[:50] == pytest.approx(columns["in_force_v"][armed][:50])
    assert source.record.position_um[:50] == pytest.approx(columns["position_um"][armed][:50])
    assert source.notes[0].startswith(f"{missed} of {source.record.t_s.size} samples were missing")


def test_recorded_delay_serves_a_drive_of_one_frequency(recording: Path, tmp_path: Path) -> None:
    """Such a drive does not determine the delay: that of the model in the file is used."""
    file = rewritten(recording, tmp_path / "sine.h5", 0, 0)
    with h5py.File(file, "r+") as root:
        axis = root["recording/axis_x"]
        axis["in_force_v"][:] = 50.0 - 50.0 * np.cos(2.0 * np.pi * 5.0 * axis["t_s"][:])
    source = read_source(file, 0.0)
    model = new_stage().config.axes["x"].model

    assert read_source(recording, 0.0).delay_s is None
    assert model is not None
    assert source.delay_s == load_model(model).delay_s
    assert "that of the model which the stage used" in source.notes[-1]


def test_long_gap_splits_a_recording(recording: Path, tmp_path: Path) -> None:
    """The longest part without a long gap is used; place and length of the gap are told."""
    file = rewritten(recording, tmp_path / "gap.h5", 300, 400)
    whole, source = read_source(recording, 0.0).record, read_source(file, 0.0)

    assert source.record.t_s.size == pytest.approx(whole.t_s.size - 400, abs=10)
    (note,) = [note for note in source.notes if "gaps" in note]
    assert "the longest of 0.202 s at 0.598 s" in note
    assert "The longest part without one is used" in note


def test_recording_without_a_movement_is_refused(tmp_path: Path) -> None:
    """A stage that was never armed gives no record."""
    stage = new_stage()
    stage.run(0.5)
    write_recording(tmp_path / "safe.h5", stage)

    with pytest.raises(DataError, match="never armed in this recording"):
        read_source(tmp_path / "safe.h5", 0.0)


def test_short_gaps_of_a_csv_file_are_filled(tmp_path: Path) -> None:
    """Up to five samples in a row are interpolated and told; the others stay as they are."""
    whole = record_of()
    keep = np.ones(whole.t_s.size, np.bool_)
    keep[[500, 800, 801, 802, 803, 804]] = False
    gappy = Record(whole.t_s[keep], whole.drive_v[keep], whole.position_um[keep])
    write_record(tmp_path / "a.csv", gappy)
    source = read_source(tmp_path / "a.csv", 0.0)

    assert source.notes[0].startswith("6 of 2500 samples were missing")
    assert source.record.position_um[keep].tolist() == whole.position_um[keep].tolist()
    assert source.record.t_s == pytest.approx(whole.t_s)
    assert source.record.drive_v == pytest.approx(whole.drive_v, abs=0.4)


def noisy(relation: float) -> Record:
    """Return a record whose displacement is noise with this share of the drive."""
    whole = record_of(duration_s=10.0)
    noise = np.random.default_rng(1).normal(size=whole.t_s.size)
    return replace(whole, position_um=noise + relation * whole.drive_v)


def test_model_worse_than_a_straight_line_is_refused(tmp_path: Path) -> None:
    """Noise gives no model: both errors are told, and what to check."""
    write_record(tmp_path / "noise.csv", noisy(0.002))

    with pytest.raises(DataError, match=r"rms, a straight line through .*check that position_um"):
        identify_file(
            tmp_path / "noise.csv",
            test=None,
            skip_s=0.0,
            delay_s=0.0,
            settings=FitSettings(order=6),
        )


def warnings_of(path: Path, record: Record, test: Record | None = None) -> list[str]:
    """Return the warnings about a model that is fitted to a record."""
    write_record(path / "a.csv", record)
    if test:
        write_record(path / "b.csv", test)
    settings = FitSettings(order=6)
    fitted = identify_file(
        path / "a.csv",
        test=path / "b.csv" if test else None,
        skip_s=0.0,
        delay_s=0.0,
        settings=settings,
    )
    return list(fitted.warnings)


def test_ringing_residual_is_named(tmp_path: Path) -> None:
    """A residual at a frequency that the drive lacks is told as a vibration; a good fit is not."""
    record = record_of()
    ringing = 0.02 * np.ptp(record.position_um) * np.sin(2.0 * np.pi * 30.0 * record.t_s)

    assert warnings_of(tmp_path, record) == []
    (warning,) = warnings_of(tmp_path, replace(record, position_um=record.position_um + ringing))
    assert "vibrates at about 30 Hz, where the drive has almost no power" in warning


def test_model_that_does_not_fit_the_test_is_told(tmp_path: Path) -> None:
    """A test of another stage gives a warning with both errors."""
    record = record_of()
    up_and_down = np.abs(1.0 - record.t_s % 3.0 / 1.5)
    other = replace(record, position_um=record.position_um.max() * up_and_down)

    warnings = warnings_of(tmp_path, record, other)
    assert any("the test seems to be of another stage" in warning for warning in warnings)
