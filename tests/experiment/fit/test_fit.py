"""Tests of fits to records, made up and measured."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezod.errors import DataError, ModelError
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.prediction import predicted_v
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.reading.record import read_record
from tests.experiment.made_up import (
    DRIVE_V,
    LEFT_WEIGHTS,
    ORDER,
    POSITION_UM,
    RATE_HZ,
    RIGHT_WEIGHTS,
    inverse_of,
    made_up_inverse,
    record_of,
)


def fitted(
    record: Record,
    method: Method = Method.LEAST_SQUARES,
    *,
    order: int = ORDER,
    delay_s: float | None = 0.0,
    lms_gain: float | None = None,
) -> Fit:
    """Fit a model of the stage's own order, by default without delay."""
    settings = FitSettings(method=method, order=order, delay_s=delay_s, lms_gain=lms_gain)
    return fit_model(record, settings)


def test_least_squares_finds_the_weights() -> None:
    """It finds the weights of a stage made of stops at the same thresholds."""
    fit = fitted(record_of())

    inverse = inverse_of(fit.model)
    assert inverse.left_stop_weights == pytest.approx(LEFT_WEIGHTS, abs=5e-4)
    assert inverse.right_stop_weights == pytest.approx(RIGHT_WEIGHTS, abs=5e-4)
    assert fit.smallest_slope == pytest.approx(made_up_inverse().smallest_slope, abs=5e-4)


@pytest.mark.parametrize(
    ("method", "max_pct", "rms_pct"), [(Method.LEAST_SQUARES, 0.05, 0.01), (Method.LMS, 0.1, 0.02)]
)
def test_voltage_is_predicted(method: Method, max_pct: float, rms_pct: float) -> None:
    """Both methods predict the drive of a stage made of stops, least squares better."""
    record = record_of()

    errors = fitted(record, method).errors_pct(record)

    assert 0.0 < errors["voltage_error_rms_pct"] < errors["voltage_error_max_pct"]
    assert errors["voltage_error_max_pct"] < max_pct
    assert errors["voltage_error_rms_pct"] < rms_pct


def test_ranges_of_the_record_become_the_model_s() -> None:
    """0 and 1 of the model are the lowest and the highest values of the record."""
    record = record_of()

    model = fitted(record).model

    assert tuple(model.drive_v) == pytest.approx((0.0, DRIVE_V), rel=1e-4)
    assert tuple(model.position_um) == pytest.approx((0.0, POSITION_UM), abs=1e-3)


def test_delay_is_estimated_only_when_none_is_given() -> None:
    """The fit has the estimate, or none."""
    record = record_of(delay_periods=2.0)

    given = fitted(record, delay_s=0.02)
    found = fitted(record, delay_s=None)

    assert (given.delay, given.model.delay_s) == (None, 0.02)
    assert found.delay is not None
    assert found.delay.delay_s == found.model.delay_s == pytest.approx(0.02, abs=0.1 / RATE_HZ)


def test_neglected_delay_increases_the_error() -> None:
    """A model that is fitted to unaligned data predicts worse, and its error shows it."""
    record = record_of(delay_periods=3.0)

    def rms_pct(delay_s: float) -> float:
        return fitted(record, delay_s=delay_s).errors_pct(record)["voltage_error_rms_pct"]

    assert rms_pct(0.0) > 10.0 * rms_pct(0.03)


def test_prediction_is_the_inverse_model_s_output() -> None:
    """The regressors predict the same voltage as the inverse model."""
    record = record_of(duration_s=10.0)
    model = fitted(record).model

    x = np.clip(model.position_um.to_unit(record.position_um), 0.0, 1.0)

    expected_v = model.drive_v.from_unit(inverse_of(model).run(x))
    assert predicted_v(model, record) == pytest.approx(expected_v, abs=1e-9)


def constant(record: Record) -> Record:
    """Return a record with a constant displacement."""
    return replace(record, position_um=np.full_like(record.position_um, 3.5))


def undriven(record: Record) -> Record:
    """Return a record of an amplifier that was off."""
    return replace(record, drive_v=np.zeros_like(record.drive_v))


def short(record: Record) -> Record:
    """Return the first 59 samples of a record."""
    return Record(record.t_s[:59], record.drive_v[:59], record.position_um[:59])


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (constant, "position_um is 3.5 throughout; allowed is a signal that varies"),
        (undriven, "drive_v is 0 throughout; allowed is a signal that varies"),
        (short, "59 samples are left for 12 weights; allowed are 60 or more"),
    ],
    ids=["constant", "undriven", "short"],
)
def test_record_that_no_model_fits_is_refused(spoil: object, text: str) -> None:
    """The error names the problem of the record and the allowed values."""
    assert callable(spoil)
    record = spoil(record_of(duration_s=5.0))

    with pytest.raises(DataError) as caught:
        fitted(record, delay_s=None)

    assert str(caught.value).startswith(text)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scale", [1e-200, 1e200, 1e300])
def test_scale_of_the_numbers_does_not_matter(scale: float) -> None:
    """In any unit the fit is the same, without overflow."""
    record = record_of(delay_periods=2.0)
    scaled = replace(record, drive_v=scale * record.drive_v, position_um=scale * record.position_um)

    plain, fit = (fitted(r, delay_s=None) for r in (record, scaled))

    assert fit.model.weights == pytest.approx(plain.model.weights, rel=1e-6)
    assert fit.model.delay_s == pytest.approx(plain.model.delay_s)
    assert fit.errors_pct(scaled) == pytest.approx(plain.errors_pct(record), rel=1e-6)


def test_delay_beyond_the_record_is_refused() -> None:
    """No sample with a known voltage is left."""
    with pytest.raises(DataError, match="0 samples are left for 12 weights"):
        fitted(record_of(duration_s=5.0), Method.LMS, delay_s=10.0)


def test_unstable_gain_is_refused() -> None:
    """The error names the gain, the operators, and a stable gain."""
    with pytest.raises(
        ModelError, match=r"gain of 0\.1 is out of range: with 100 operators.*0\.03"
    ):
        fitted(record_of(), Method.LMS, order=100, lms_gain=0.1)


def test_with_many_operators_the_gain_is_lowered_until_it_is_stable() -> None:
    """Without a given gain, LMS fits a model of any order."""
    fit = fitted(record_of(), Method.LMS, order=100)

    assert np.all(np.isfinite(fit.model.weights))
    assert fit.errors_pct(record_of())["voltage_error_rms_pct"] < 2.0


@pytest.mark.parametrize("offset_um", [-119.0, 0.0, 50.0])
def test_model_is_zeroed_at_the_displacement_at_rest(offset_um: float) -> None:
    """For any zero of the recorded data the zero of the model is at rest."""
    record = record_of()
    shifted = replace(record, position_um=record.position_um + offset_um)
    fit = fitted(shifted)
    zeroed = fit.model.zeroed_at(float(record.drive_v.min()))

    assert zeroed.position_um.low == pytest.approx(0.0, abs=1e-6)
    assert zeroed.position_um.width == pytest.approx(fit.model.position_um.width)


def test_rest_between_the_ends_is_in_the_middle_of_the_loop() -> None:
    """The displacement at rest is where a decaying swing ends, on neither of the branches."""
    record = record_of()
    model = fitted(record).model
    middle_v = model.drive_v.from_unit(0.5)
    at_rest = model.position_um.low - model.zeroed_at(middle_v).position_um.low
    unit = model.position_um.to_unit(at_rest)

    (low,), (high,) = model.form.position_range(model.weights, np.array([0.5]))
    assert high - low > 0.1
    assert unit == pytest.approx(0.5 * (low + high), abs=0.15 * (high - low))


def test_rest_voltage_outside_the_model_is_refused() -> None:
    """The displacement at rest is then unknown."""
    model = fitted(record_of()).model

    with pytest.raises(DataError, match=r"the rest voltage is .*a drive that starts at rest"):
        model.zeroed_at(model.drive_v.low - 0.1 * model.drive_v.width)


def measured(shared_data: Path, name: str) -> Record:
    """Return a record of the measured flexure stage, without its first second."""
    columns = read_record(shared_data / "data" / "ntu_p885" / name).columns
    return Record(columns["t_s"], columns["drive_v"], columns["position_um"], run_in_s=1.0)


@pytest.mark.parametrize(
    ("method", "max_pct", "rms_pct"), [(Method.LEAST_SQUARES, 1.6, 0.35), (Method.LMS, 1.6, 0.4)]
)
def test_measured_stage_is_predicted(
    shared_data: Path, method: Method, max_pct: float, rms_pct: float
) -> None:
    """Either method predicts the drive voltage of a measured stage from its displacement."""
    record = measured(shared_data, "identification.csv")

    fit = fit_model(record, FitSettings(method=method))

    errors = fit.errors_pct(record)
    assert errors["voltage_error_max_pct"] < max_pct
    assert errors["voltage_error_rms_pct"] < rms_pct
    assert fit.smallest_slope > 0.2


def test_model_of_a_measured_stage_carries_over(shared_data: Path) -> None:
    """At other amplitudes the error grows, but stays far below the width of the loop."""
    fit = fit_model(measured(shared_data, "identification.csv"), FitSettings())

    errors = fit.errors_pct(measured(shared_data, "test.csv"))

    assert errors["voltage_error_max_pct"] < 4.5
    assert errors["voltage_error_rms_pct"] < 2.0
