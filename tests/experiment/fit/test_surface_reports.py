"""Tests of what the fit of a surface finds and reports: delay, creep, warnings, uncertainty."""

from dataclasses import replace

import numpy as np
import pytest

from piezod.experiment.fit.errors import cross_validate
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.surface.parameters import MAX_LAG
from piezod.experiment.fit.uncertainty import uncertainty_of
from piezod.experiment.fit.warnings import fit_warnings
from tests.experiment.made_up import sine
from tests.experiment.made_up_surface import made_up_surface, surface_record

SURFACE = FitSettings(method=Method.SURFACE, creep=True, smoothing=False)
UNDELAYED = replace(SURFACE, delay_s=0.0)


@pytest.mark.parametrize("delay_s", [-0.004, 0.006])
def test_surface_creep_and_delay_are_found(delay_s: float) -> None:
    """A fit finds a stage that is a surface with creep, with a delay of either sign."""
    record = surface_record(delay_s=delay_s, creep=0.005)

    fit = fit_model(record, SURFACE)

    assert fit.model.delay_s == pytest.approx(delay_s, abs=2e-4)
    assert fit.model.creep.per_decade == pytest.approx(0.01, rel=0.05)
    assert fit.model.weights == pytest.approx(made_up_surface(), abs=0.02)
    assert fit.errors_pct(record)["position_error_rms_pct"] < 0.02
    assert fit.delay
    assert fit.delay.of_position


def test_last_samples_do_not_count_with_a_negative_delay() -> None:
    """Their voltage is not in the record."""
    record = surface_record(duration_s=10.0)

    assert not record.counted(-0.025)[-2:].any()
    assert record.counted(-0.025)[:-3].all()


def test_record_of_one_frequency_bounds_the_creep() -> None:
    """Lags of a sinusoid are sinusoids: the search stays bounded, and the record is described."""
    record = surface_record(drive=sine, creep=0.005, noise=0.001)

    fit = fit_model(record, UNDELAYED)

    assert np.all(fit.model.creep.weights <= MAX_LAG)
    assert fit.model.creep.per_decade < 0.05
    assert fit.errors_pct(record)["position_error_rms_pct"] < 0.2


def test_creep_stays_within_the_limits_of_a_model_file() -> None:
    """The weight of a lag is at most 0.1, whatever the record asks for."""
    fit = fit_model(surface_record(creep=0.12, duration_s=20.0), UNDELAYED)

    assert np.max(fit.model.creep.weights) == pytest.approx(MAX_LAG)
    assert np.max(fit.model.creep.weights) <= MAX_LAG


def test_record_without_small_loops_has_a_warning() -> None:
    """A surface is determined by the loops of its record only."""
    poor, rich = (
        tuple(fit_warnings(fit_model(record, UNDELAYED), 0.01))
        for record in (surface_record(drive=sine), surface_record())
    )

    assert "The record does not have loops of all sizes and heights." in poor[0]
    assert rich == ()


def test_creep_before_the_record_is_that_of_its_first_position() -> None:
    """A record that starts away from the zero of the sensor is described as well."""
    record = surface_record(creep=0.01, duration_s=20.0)
    shifted = replace(record, position_um=record.position_um + 20.0)

    plain, moved = (fit_model(each, SURFACE) for each in (record, shifted))

    assert moved.model.creep.per_decade == pytest.approx(plain.model.creep.per_decade, rel=1e-3)
    for each, fit in ((record, plain), (shifted, moved)):
        errors = fit.errors_pct(each)
        assert errors["position_error_rms_pct"] < 0.02
        assert errors["voltage_error_rms_pct"] < 0.03


@pytest.mark.stress
def test_band_is_the_scatter_of_the_predicted_voltage() -> None:
    """The band follows from one record; the scatter over records with other noise agrees."""
    fits = [
        fit_model(surface_record(noise=0.002, seed=seed, duration_s=10.0), UNDELAYED)
        for seed in range(12)
    ]
    clean = surface_record(duration_s=10.0)
    predicted_v = np.stack([fit.predicted_v(clean) for fit in fits])
    scatter_pct = 100.0 * np.std(predicted_v, axis=0, ddof=1) / fits[0].model.drive_v.width

    uncertainty = uncertainty_of(fits[0], cross_validate(fits[0]))

    assert uncertainty.band_pct is not None
    ratio = np.sqrt(np.mean(uncertainty.band_pct**2) / np.mean((1.96 * scatter_pct) ** 2))
    assert ratio == pytest.approx(1.0, rel=0.5)
    assert uncertainty.creep_per_decade is not None
    creeps = [fit.model.creep.per_decade for fit in fits]
    assert 0.2 < 1.96 * np.std(creeps, ddof=1) / uncertainty.creep_per_decade < 3.0
