"""Tests of models that are written to files and read back."""

import hashlib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from piezod.config.model_file import ModelFile, dump_model, load_model
from piezod.control.law.creep import logarithmic
from piezod.control.law.model_files import from_model_file, read_model
from piezod.errors import ConfigError, ModelError
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.model_io import to_model_file
from piezod.experiment.fit.prediction import predicted_v
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from tests.experiment.made_up import ORDER, inverse_of, record_of, stops_of

MADE_AT = datetime(2024, 5, 1, 12, 0, 0, tzinfo=UTC)


@pytest.fixture(scope="module")
def record() -> Record:
    """Return a record with a delay of a fraction of a sample."""
    return record_of(delay_periods=1.34)


@pytest.fixture(scope="module")
def fit(record: Record) -> Fit:
    """Return a model with numbers that need all digits."""
    fit = fit_model(record, FitSettings(order=ORDER))
    return replace(fit, model=replace(fit.model, creep=logarithmic(1.0 / 300.0)))


@pytest.fixture
def file(tmp_path: Path, record: Record, fit: Fit) -> ModelFile:
    """Return the contents of a model file."""
    source = tmp_path / "data.csv"
    source.write_bytes(b"t_s\n")
    return to_model_file(fit, source, fit.errors_pct(record), MADE_AT)


def test_model_is_restored_to_the_bit(tmp_path: Path, fit: Fit, file: ModelFile) -> None:
    """Every number of a model is the same after the text of a file."""
    path = tmp_path / "model.yaml"
    path.write_text(dump_model(file), encoding="utf-8")

    again, _ = read_model(path)

    assert np.array_equal(stops_of(again).bank, stops_of(fit.model).bank)
    assert np.array_equal(again.weights, fit.model.weights)
    assert again.drive_v == fit.model.drive_v
    assert again.position_um == fit.model.position_um
    assert again.delay_s == fit.model.delay_s
    assert np.array_equal(again.creep, fit.model.creep)


def test_model_from_a_file_predicts_the_same(record: Record, fit: Fit, file: ModelFile) -> None:
    """Right and left operators keep their sides."""
    again = from_model_file(file)

    assert np.array_equal(predicted_v(again, record), predicted_v(fit.model, record))
    assert file.right_stop_weights == tuple(inverse_of(fit.model).right_stop_weights)
    assert file.left_stop_weights == tuple(inverse_of(fit.model).left_stop_weights)


def test_file_has_the_origin_of_the_model(record: Record, fit: Fit, file: ModelFile) -> None:
    """It contains the method, the data with their hash, the time and the errors."""
    assert file.method == "least-squares"
    assert file.created_at == "2024-05-01T12:00:00+00:00"
    assert file.created_by.startswith("piezod ")
    assert file.source.file == "data.csv"
    assert file.source.sha256 == hashlib.sha256(b"t_s\n").hexdigest()
    assert file.fit.model_dump() == fit.errors_pct(record)


def test_model_beyond_the_ranges_of_a_file_is_refused(tmp_path: Path) -> None:
    """A drive in millivolts is refused with the name of the quantity."""
    source = tmp_path / "data.csv"
    source.touch()
    in_volts = record_of()
    record = Record(in_volts.t_s, 1e3 * in_volts.drive_v, in_volts.position_um)
    fit = fit_model(record, FitSettings(order=ORDER, delay_s=0.0))

    with pytest.raises(ModelError, match=r"a model file cannot .* drive_high_v: out of range"):
        to_model_file(fit, source, fit.errors_pct(record), MADE_AT)


@pytest.mark.parametrize("weight", [-2.0, 0.9])
def test_model_that_is_not_monotone_is_refused_with_the_file_s_name(
    tmp_path: Path, file: ModelFile, weight: float
) -> None:
    """A drive against the command is of no use; the error names the remedy."""
    steep = {"left_stop_weights": (weight,) * ORDER, "right_stop_weights": (weight,) * ORDER}
    path = tmp_path / "model.yaml"
    path.write_text(dump_model(file.model_copy(update=steep)), encoding="utf-8")

    with pytest.raises(ConfigError) as caught:
        read_model(path)

    assert str(caught.value).startswith(f"{path}: the model is not monotone: its smallest slope is")
    assert str(caught.value).endswith("identify again")


def test_creep_beyond_the_range_of_a_file_is_refused(tmp_path: Path, fit: Fit) -> None:
    """No stage creeps as much as it moves."""
    source = tmp_path / "data.csv"
    source.touch()
    creeping = replace(fit, model=replace(fit.model, creep=logarithmic(0.11)))
    errors_pct = {"voltage_error_max_pct": 1.0, "voltage_error_rms_pct": 0.1}

    with pytest.raises(ModelError, match=r"a model file cannot .* creep_weights.*: out of range"):
        to_model_file(creeping, source, errors_pct, MADE_AT)


def test_uneven_sides_are_refused_with_the_file_s_name(tmp_path: Path, file: ModelFile) -> None:
    """A model needs the same number of right and left stops."""
    fewer = {"left_stop_thresholds": (0.5,), "left_stop_weights": (0.1,)}
    path = tmp_path / "model.yaml"
    path.write_text(dump_model(file.model_copy(update=fewer)), encoding="utf-8")
    assert load_model(path).left_stop_weights == (0.1,)

    with pytest.raises(ConfigError) as caught:
        read_model(path)

    assert str(caught.value) == f"{path}: a bank has as many left as right stops, got 1 and 6"
