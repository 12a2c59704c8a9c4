"""Tests of fits of a surface to records of a stage whose hysteresis is one."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from piezod.errors import DataError
from piezod.experiment.fit.errors import cross_validate
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.spectrum import noise_density_of
from piezod.experiment.fit.surface.gauss_newton import LinearisedSurface
from piezod.experiment.fit.surface.parameters import CREEP, OFFSET
from piezod.experiment.fit.uncertainty import (
    SIGMAS_95,
    SURFACE_COVERAGE,
    covariance_of,
    uncertainty_of,
)
from piezod.hysteresis import LEAST_SLOPE
from piezod.hysteresis.everett_bounds import least_surface_slope
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import PathRelaxation
from piezod.hysteresis.surface_form import SurfaceForm, surface_regressors
from tests.control.made_up import SURFACE
from tests.experiment.made_up import DRIVE_V, POSITION_UM, RATE_HZ, swells
from tests.experiment.made_up_surface import surface_record, two_frequencies
from tests.hysteresis.surfaces import invertible_with

NOISE = 1e-3
swelling_record = partial(
    surface_record, weights=SURFACE.weights, drive=two_frequencies, duration_s=25.0
)


def fitted(record: Record, *, creep: bool = False, delay_s: float | None = None) -> Fit:
    """Fit a surface."""
    return fit_model(record, FitSettings(method=Method.SURFACE, creep=creep, delay_s=delay_s))


def linear(fit: Fit) -> LinearisedSurface:
    """Return the problem around the solution."""
    assert isinstance(fit.linearised, LinearisedSurface)
    return fit.linearised


def worst_miss(fit: Fit) -> float:
    """Return the worst error of the displacement on loops that are not in the record."""
    k = np.arange(3000)
    drives = 0.5 - 0.5 * np.cos(k / 37) * np.cos(k / 911)
    found = fit.model.form.positions_at(fit.model.weights, drives)
    return float(np.max(np.abs(found - SURFACE.form.positions_at(SURFACE.weights, drives))))


@pytest.mark.parametrize(
    ("delay_periods", "creep"),
    [
        *((delay_periods, 0.0) for delay_periods in (0.0, 1.3, -0.7, -2.5)),
        (1.3, 0.004),
        (-0.7, 0.004),
        pytest.param(0.0, 0.004, marks=pytest.mark.stress),
        pytest.param(-2.5, 0.004, marks=pytest.mark.stress),
    ],
)
@pytest.mark.few(2)
def test_stage_is_found(delay_periods: float, creep: float) -> None:
    """Surface, creep and a delay of either sign are found, also on other loops."""
    fit = fitted(swelling_record(delay_s=delay_periods / RATE_HZ, creep=creep), creep=creep > 0.0)

    assert fit.delay is not None
    assert fit.model.delay_s * RATE_HZ == pytest.approx(delay_periods, abs=0.03)
    assert abs(fit.model.delay_s - delay_periods / RATE_HZ) < fit.delay.uncertainty_s
    assert worst_miss(fit) < 2e-3
    assert fit.model.creep.per_decade == pytest.approx(2.0 * creep, abs=1e-3)
    assert fit.smallest_slope >= LEAST_SLOPE - 1e-9
    assert fit.errors_pct(fit.record)["voltage_error_rms_pct"] < 0.03


def test_stage_is_found_in_noise() -> None:
    """With noise, an offset and creep, and a delay between two samples that is interpolated."""
    record = swelling_record(
        delay_s=-0.4 / RATE_HZ, creep=0.004, offset=0.1, noise=NOISE, duration_s=50.0
    )
    fit = fitted(record, creep=True)
    uncertainty = uncertainty_of(fit, cross_validate(fit))

    assert fit.delay is not None
    assert uncertainty.creep_per_decade is not None
    assert abs(fit.model.delay_s + 0.4 / RATE_HZ) < 0.1 * fit.delay.uncertainty_s
    assert abs(fit.model.creep.per_decade - 0.008) < uncertainty.creep_per_decade + 5e-4
    assert fit.model.position_um.low == pytest.approx(0.1 * POSITION_UM, abs=0.1)
    assert worst_miss(fit) < 3e-3


@pytest.mark.parametrize("activation", [0.0, 0.003, 0.01])
@pytest.mark.few(2)
def test_lag_with_the_rate_is_found_only_where_it_is(activation: float) -> None:
    """A stage without it gets a model without it, and a stage with it gets its size."""
    fit = fitted(swelling_record(activation=activation, noise=NOISE, duration_s=50.0))
    form = fit.model.form

    assert isinstance(form, SurfaceForm)
    assert form.activation == pytest.approx(activation, rel=0.1, abs=0.0)
    assert (form.prompt_slope > 0.0) == (activation > 0.0)


@pytest.mark.parametrize(
    ("decay", "skew", "exponent"),
    [
        (2.0, 0.1, 1.0),
        pytest.param(3.0, 0.1, 2.0, marks=pytest.mark.stress),
        pytest.param(1.0, 0.0, 1.0, marks=pytest.mark.stress),
        pytest.param(8.0, -0.3, 1.0, marks=pytest.mark.stress),
        pytest.param(2.0, 0.0, 1.5, marks=pytest.mark.stress),
    ],
)
def test_relaxation_along_the_path_is_found(decay: float, skew: float, exponent: float) -> None:
    """A stage with it gets its parameters, in units of its range."""
    path = PathRelaxation(-0.2, decay, skew, exponent)
    fit = fitted(swelling_record(path=path, creep=0.004, noise=NOISE, duration_s=50.0), creep=True)

    assert fit.path is not None
    unit = SurfaceForm(path=path).rise(invertible_with(path, SURFACE.weights))
    assert fit.path.weight * unit == pytest.approx(path.weight, rel=0.1)
    assert fit.path.decay == pytest.approx(decay, rel=0.15)
    assert fit.path.skew == pytest.approx(skew, abs=0.1)
    assert fit.path.exponent == pytest.approx(exponent, rel=0.1)
    assert fit.smallest_slope > 0.0
    highest = fit.model.form.positions_at(fit.model.weights, np.array([1.0]))
    assert highest[0] == pytest.approx(1.0)


def test_relaxation_that_leaves_no_inverse_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search bounds the slopes with the skew before its last step, so the result is checked."""
    path = PathRelaxation(-0.2, 2.0, 0.1)
    record = swelling_record(path=path, creep=0.004, noise=NOISE, duration_s=50.0)
    monkeypatch.setattr(PathRelaxation, "least_slope", -10.0)

    assert fitted(record, creep=True).path is None


@pytest.mark.parametrize(
    ("activation", "creep"),
    [
        (0.0, True),
        (0.01, True),
        (0.0, False),
        pytest.param(0.01, False, marks=pytest.mark.stress),
    ],
)
@pytest.mark.few(1)
def test_no_relaxation_is_found_where_there_is_none(activation: float, creep: bool) -> None:
    """A stage that creeps and remembers turning points only gets a model without it."""
    record = swelling_record(activation=activation, creep=0.004, noise=NOISE)

    assert fitted(record, creep=creep).path is None


def test_displacement_is_one_at_the_highest_drive() -> None:
    """[0, 1] of the model is the displacement without creep at the ends of the drive."""
    fit = fitted(swelling_record())
    model = fit.model

    assert model.form.positions_at(model.weights, np.array([1.0]))[0] == pytest.approx(1.0)
    assert tuple(model.drive_v) == pytest.approx((0.0, DRIVE_V), rel=1e-3)
    assert tuple(model.position_um) == pytest.approx((0.0, POSITION_UM), abs=0.02)


def test_constraints_hold_if_the_record_would_break_them() -> None:
    """Small loops in much noise determine no surface, but the fitted one can be inverted."""
    k = np.arange(3000)
    drives = 0.5 - 0.5 * np.cos(k / 37) * np.exp(-k / 200.0)
    noise = 0.05 * np.random.default_rng(1).standard_normal(k.size)
    positions = SURFACE.form.positions_at(SURFACE.weights, drives) + noise
    regressors = surface_regressors(drives, SurfaceForm())[:, :24]
    free: FloatArray = np.linalg.lstsq(regressors, positions, rcond=None)[0].astype(np.float64)
    assert least_surface_slope(free) < -1.0

    record = Record(k / RATE_HZ, DRIVE_V * drives, POSITION_UM * positions)
    fit = fitted(record, creep=True, delay_s=0.0)

    assert least_surface_slope(linear(fit).parameters[:24]) >= LEAST_SLOPE - 1e-6
    assert fit.smallest_slope > 0.0
    assert np.all(fit.model.creep.weights >= 0.0)


def test_without_creep_the_model_has_none() -> None:
    """A stage that creeps is fitted without creep unless it is requested."""
    fit = fitted(swelling_record(creep=0.004))

    assert fit.model.creep.weights.size == 0
    assert uncertainty_of(fit, cross_validate(fit)).creep_per_decade is None


@pytest.mark.parametrize("delay_periods", [-1.3, -0.02, 0.02, 0.6, 2.02])
@pytest.mark.few(2)
def test_samples_that_count_are_those_of_the_found_delay(delay_periods: float) -> None:
    """The band of the prediction has one value for each sample that the errors count."""
    fit = fitted(swelling_record(delay_s=delay_periods / RATE_HZ))
    band_pct = uncertainty_of(fit, cross_validate(fit)).band_pct

    assert band_pct is not None
    assert band_pct.size == fit.residuals_pct(fit.record).size


def test_given_delay_is_kept() -> None:
    """A delay that is given is not searched, and has no estimate."""
    fit = fitted(swelling_record(delay_s=-1.0 / RATE_HZ), delay_s=-1.0 / RATE_HZ)

    assert (fit.delay, fit.model.delay_s) == (None, -1.0 / RATE_HZ)
    assert worst_miss(fit) < 1e-3


def test_delay_of_one_frequency_is_that_of_the_stops() -> None:
    """A single frequency does not separate delay and hysteresis; the estimate reports that."""
    fit = fitted(swelling_record(drive=swells, delay_s=1.0 / RATE_HZ))

    assert fit.delay is not None
    assert fit.delay.one_frequency
    assert fit.model.delay_s == fit.delay.delay_s == pytest.approx(0.01, abs=0.005)


def test_curve_of_delays_has_its_least_at_the_delay() -> None:
    """The errors of other delays rise on both sides of the best one."""
    fit = fitted(swelling_record(delay_s=-0.7 / RATE_HZ))

    assert fit.delay is not None
    best = int(fit.delay.criterion_pct.argmin())
    assert fit.delay.candidates_s[best] == pytest.approx(fit.model.delay_s)
    assert np.all(np.diff(fit.delay.criterion_pct[: best + 1]) < 0.0)
    assert np.all(np.diff(fit.delay.criterion_pct[best:]) > 0.0)


@pytest.mark.parametrize("creep", [False, True])
def test_uncertainty_covers_the_truth(creep: bool) -> None:
    """In most of 15 draws of the noise the true prediction is in the band, which is not too wide.

    With creep, the same holds for the creep per decade.
    """
    record = swelling_record(creep=0.004 if creep else 0.0, duration_s=50.0)
    fit = fitted(record, creep=creep)
    known = linear(fit)
    truth = known.regressors @ known.parameters
    inside, ratios, creeps = [], [], []
    for seed in range(15):
        target = truth + NOISE * np.random.default_rng(seed).standard_normal(truth.size)
        drawn = replace(known, target=target)
        drawn = replace(drawn, parameters=drawn.solved(drawn.counted))
        _, covariance = covariance_of(drawn)
        error = drawn.regressors @ (drawn.parameters - known.parameters)
        scatter = np.sqrt(
            np.einsum("ki,ij,kj->k", drawn.regressors, covariance, drawn.regressors, optimize=True)
        )
        inside.append(np.abs(error) <= SIGMAS_95 * scatter)
        ratios.append(np.mean(error**2) / np.mean(scatter**2))
        lags = slice(CREEP, OFFSET)
        half = SIGMAS_95 * 2.0 * np.sqrt(np.mean(covariance[lags, lags]))
        miss = 2.0 * np.mean(drawn.parameters[lags] - known.parameters[lags])
        creeps.append(abs(miss) <= half)

    assert np.mean(inside) > 0.9
    assert 0.3 < np.mean(ratios) < 1.5
    assert np.mean(creeps) > 0.8


def test_creep_is_as_uncertain_as_the_mean_of_its_lags() -> None:
    """The stated half width is that of the creep per decade, not that of one lag."""
    fit = fitted(swelling_record(creep=0.004, noise=NOISE, duration_s=50.0), creep=True)
    noise = 1e-4 * noise_density_of(fit.position_residuals_pct(fit.recorded))
    covariance = linear(fit).covariance(SURFACE_COVERAGE**2 * noise)
    one_lag = SIGMAS_95 * 2.0 * float(np.sqrt(covariance[CREEP, CREEP]))

    stated = uncertainty_of(fit, cross_validate(fit)).creep_per_decade

    expected = SIGMAS_95 * 2.0 * float(np.sqrt(np.mean(covariance[CREEP:OFFSET, CREEP:OFFSET])))
    assert stated == pytest.approx(expected)
    assert expected < 0.5 * one_lag


def test_model_without_a_block_is_fitted_to_the_others() -> None:
    """A fault in a block changes the whole fit, and not the model without that block."""
    clean = swelling_record(creep=0.004)
    drive_v = clean.drive_v.copy()
    drive_v[500:800] += 10.0
    held_out = np.zeros(drive_v.size, dtype=np.bool_)
    held_out[490:810] = True

    fit = fitted(replace(clean, drive_v=drive_v), creep=True, delay_s=0.0)
    without = fit.without(held_out)

    def miss(weights: FloatArray) -> float:
        return float(np.max(np.abs(weights - SURFACE.weights)))

    assert miss(without.weights) < 0.5 * miss(fit.model.weights)
    assert without.delay_s == fit.model.delay_s
    assert without.creep.weights.size == 8


def test_first_solution_does_not_depend_on_old_memory() -> None:
    """The fit is the same to the bit every time; unused columns are zero, not what was there."""
    record = swelling_record(delay_s=1.3 / RATE_HZ)
    rubbish = [np.full((record.t_s.size, 34), np.nan) for _ in range(20)]
    first = fitted(record).model.weights
    del rubbish
    again = fitted(record).model.weights

    assert np.all(np.isfinite(first))
    assert first.tolist() == again.tolist()


def test_short_record_is_refused_with_the_number_of_coefficients() -> None:
    """A surface has 24 coefficients, for any number of operators."""
    record = swelling_record()
    short = Record(record.t_s[:110], record.drive_v[:110], record.position_um[:110])

    with pytest.raises(DataError) as caught:
        fitted(short)

    assert str(caught.value) == (
        "110 samples are left for 24 weights; allowed are 120 or more; record for longer, or skip "
        "less"
    )
