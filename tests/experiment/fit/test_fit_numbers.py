"""Numbers of a fit beside its record."""

import numpy as np
import pytest

from piezod.experiment.fit.errors import cross_validate
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.fit_numbers import numbers_of_fit
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.settings import FitSettings
from tests.experiment.made_up import ORDER, RATE_HZ, record_of
from tests.experiment.made_up_surface import surface_record


@pytest.mark.parametrize("delay_periods", [0.0, 2.0, 2.5])
def test_numbers_have_the_record_and_the_prediction_beside_it(
    delay_periods: float,
) -> None:
    """The residual is that of the fit for any delay; the end of the record is not predicted."""
    record = record_of(delay_periods=delay_periods)
    delay_s = delay_periods / RATE_HZ
    fit = fit_model(record, FitSettings(order=ORDER, delay_s=delay_s))

    validation = cross_validate(fit)
    numbers = numbers_of_fit(fit, record, validation, axis="x", title="made up")

    assert np.array_equal(numbers.t_s, record.t_s)
    assert np.array_equal(numbers.drive_v, record.drive_v)
    assert np.array_equal(numbers.position_um, record.position_um)
    known = np.isfinite(numbers.residual_v)
    assert np.count_nonzero(~known) == np.count_nonzero(~known[-3:]) == int(np.ceil(delay_periods))
    rms_pct = 100.0 * float(np.sqrt(np.mean(numbers.residual_v[known] ** 2)))
    rms_pct /= numbers.drive_range_v
    assert rms_pct == pytest.approx(numbers.fit_errors["voltage_error_rms_pct"], rel=0.3, abs=1e-3)


def test_nothing_is_predicted_in_the_run_in() -> None:
    """Samples that do not count are not shown as errors."""
    record = record_of().after(2.0)

    fit = fit_model(record, FitSettings(order=ORDER, delay_s=0.0))
    numbers = numbers_of_fit(fit, record, cross_validate(fit), axis="x", title="")

    assert np.array_equal(np.isfinite(numbers.predicted_v), record.counted())


def test_numbers_have_the_judgement_of_the_fit() -> None:
    """Beside the errors on the record are those on held-out blocks, and the delay's uncertainty."""
    record = record_of(delay_periods=2.0, noise=0.05)
    estimated, given = (
        fit_model(record, FitSettings(order=ORDER, delay_s=delay_s)) for delay_s in (None, 0.02)
    )
    validation = cross_validate(estimated)
    errors = numbers_of_fit(estimated, record, validation, axis="x", title="").fit_errors

    assert errors["held_out_voltage_error_rms_pct"] == validation.rms_pct
    assert errors["held_out_voltage_error_rms_pct"] > errors["voltage_error_rms_pct"]
    assert estimated.delay is not None
    assert errors["delay_uncertainty_ms"] == 1e3 * estimated.delay.uncertainty_s
    without = numbers_of_fit(given, record, cross_validate(given), axis="x", title="").fit_errors
    assert "delay_uncertainty_ms" not in without


def test_nothing_is_predicted_before_the_first_displacement() -> None:
    """With a negative delay, the first voltages belong to displacements before the record."""
    record = surface_record(delay_s=-0.025)
    fit = fit_model(record, FitSettings(method=Method.SURFACE, smoothing=False))

    numbers = numbers_of_fit(fit, record, cross_validate(fit), axis="x", title="")

    assert np.isnan(numbers.predicted_v[:2]).all()
    assert np.isfinite(numbers.predicted_v[3:]).all()
    assert "held_out_position_error_rms_pct" in numbers.fit_errors
