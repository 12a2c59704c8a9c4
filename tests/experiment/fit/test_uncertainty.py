"""Tests of the uncertainty of a model."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from piezod.experiment.fit.errors import cross_validate
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.least_squares import LinearisedStops
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.uncertainty import (
    SIGMAS_95,
    Uncertainty,
    covariance_of,
    uncertainty_of,
)
from tests.conftest import Figure
from tests.control.made_up import SURFACE
from tests.experiment.made_up import (
    DRIVE_V,
    ORDER,
    POSITION_UM,
    RATE_HZ,
    record_of,
    sine,
    swells,
)
from tests.experiment.made_up_surface import surface_record, two_frequencies

NOISE = 0.002
"""Noise of the voltage, as a share of its range."""


def noisy(seed: int, duration_s: float = 25.0) -> Record:
    """Return a record whose voltage has white noise, which no model can predict."""
    record = record_of(path=swells, duration_s=duration_s)
    noise_v = NOISE * DRIVE_V * np.random.default_rng(seed).standard_normal(record.t_s.size)
    return replace(record, drive_v=record.drive_v + noise_v)


def fitted(record: Record, **changed: object) -> Fit:
    """Fit a model of the stage's own order, without smoothing, except for the changed settings."""
    settings = {"order": ORDER, "delay_s": 0.0, "smoothing": False, **changed}
    return fit_model(record, FitSettings(**settings))  # type: ignore[arg-type]  # names in a table


def judged(record: Record, **changed: object) -> tuple[Fit, Uncertainty]:
    """Return a fit and its uncertainty."""
    fit = fitted(record, **changed)
    return fit, uncertainty_of(fit, cross_validate(fit))


def test_band_contains_the_true_prediction() -> None:
    """With known noise, 19 of 20 predictions are in the band, and it is not wider than that."""
    linear = fitted(record_of(path=swells)).linearised
    assert isinstance(linear, LinearisedStops)
    truth = linear.regressors @ linear.parameters
    inside, ratios = [], []
    for seed in range(40):
        target = truth + NOISE * np.random.default_rng(seed).standard_normal(truth.size)
        parameters = replace(linear, target=target).solved(linear.counted)
        drawn = replace(linear, target=target, parameters=parameters)
        _, covariance = covariance_of(drawn)
        rows = drawn.regressors
        error = rows @ (parameters - linear.parameters)
        scatter = np.sqrt(np.einsum("ki,ij,kj->k", rows, covariance, rows))
        inside.append(np.abs(error) <= SIGMAS_95 * scatter)
        ratios.append(np.mean(error**2) / np.mean(scatter**2))
    assert np.mean(inside) > 0.9
    assert 0.3 < np.mean(ratios) < 1.5


def test_longer_record_has_a_narrower_band() -> None:
    """Four times as many samples give about half the band."""
    short, long = (judged(noisy(1, duration_s))[1].band_pct for duration_s in (25.0, 100.0))

    assert short is not None
    assert long is not None
    assert np.mean(long) / np.mean(short) == pytest.approx(0.5, rel=0.3)


def test_correlated_residuals_count_as_fewer_samples() -> None:
    """White residuals are nearly independent; slowly changing ones are not."""
    record = noisy(1)
    white = fitted(record).linearised
    slow_v = 4.0 * np.convolve(
        np.random.default_rng(2).standard_normal(record.t_s.size), np.ones(40) / 40.0, mode="same"
    )
    alike = fitted(replace(record, drive_v=record.drive_v + slow_v)).linearised

    assert white is not None
    assert alike is not None
    assert covariance_of(white)[0] > 0.5 * record.t_s.size
    assert covariance_of(alike)[0] < 0.2 * record.t_s.size


def test_creep_is_as_uncertain_as_it_scatters() -> None:
    """The true creep is within its interval."""
    record = record_of(path=swells, creep=0.005, noise=0.001, duration_s=50.0)

    fit, uncertainty = judged(record, creep=True, smoothing=True)

    assert uncertainty.creep_per_decade is not None
    assert abs(fit.model.creep.per_decade - 0.01) < 3.0 * uncertainty.creep_per_decade + 5e-4
    assert len(uncertainty.block_creep_per_decade) == 5
    assert min(uncertainty.block_creep_per_decade) > 0.0


def test_given_delay_has_no_uncertainty() -> None:
    """An estimated delay has one, also from a record of one frequency, which hardly shows it."""
    record = record_of(delay_periods=2.0, noise=0.001)
    alone = record_of(path=sine, delay_periods=2.0, noise=0.001)

    assert judged(record, delay_s=0.02)[1].delay_s is None
    assert 0.0 < (judged(record, delay_s=None)[1].delay_s or 0.0) < 0.002
    assert (judged(alone, delay_s=None)[1].delay_s or 0.0) >= 0.01


DELAY_PERIODS, CREEP = 1.3, 0.004


def _of_surface(seed: int, duration_s: float) -> tuple[Fit, Uncertainty]:
    record = surface_record(
        weights=SURFACE.weights,
        drive=two_frequencies,
        duration_s=duration_s,
        delay_s=DELAY_PERIODS / RATE_HZ,
        creep=CREEP,
        noise=0.001,
        seed=seed,
    )
    return judged(record, method=Method.SURFACE, delay_s=None, creep=True, smoothing=True)


def _of_stops(seed: int, duration_s: float) -> tuple[Fit, Uncertainty]:
    clean = record_of(delay_periods=DELAY_PERIODS, creep=CREEP, duration_s=duration_s)
    noise_um = 0.001 * POSITION_UM * np.random.default_rng(seed).standard_normal(clean.t_s.size)
    record = replace(clean, position_um=clean.position_um + noise_um)
    return judged(record, delay_s=None, creep=True, smoothing=True)


@pytest.mark.parametrize(
    ("repeat", "repeats", "duration_s"),
    [
        (_of_stops, 8, 20.0),
        pytest.param(_of_stops, 30, 50.0, marks=pytest.mark.stress),
        pytest.param(_of_surface, 30, 50.0, marks=pytest.mark.stress),
    ],
)
def test_stated_errors_are_those_of_repeats(
    figure: Figure,
    repeat: Callable[[int, float], tuple[Fit, Uncertainty]],
    repeats: int,
    duration_s: float,
) -> None:
    """Where noise is the only error, delay and creep scatter as stated."""
    found, stated = np.empty((2, repeats, 2))
    for seed in range(repeats):
        fit, uncertainty = repeat(seed, duration_s)
        found[seed] = fit.model.delay_s * RATE_HZ, fit.model.creep.per_decade
        assert uncertainty.delay_s is not None
        assert uncertainty.creep_per_decade is not None
        stated[seed] = uncertainty.delay_s * RATE_HZ, uncertainty.creep_per_decade

    errors = np.abs(found - np.mean(found, axis=0))
    inside = np.mean(errors <= stated, axis=0)
    ratios = np.mean(stated, axis=0) / SIGMAS_95 / np.std(found, axis=0, ddof=1)
    figure(f"{repeat.__name__}, {repeats} repeats: delay and creep inside {inside}, σ {ratios}")
    assert np.all(inside >= 0.85)
    assert np.all(ratios <= 5.0)


def test_lms_has_only_the_spread_over_the_blocks() -> None:
    """LMS solves no problem with a covariance."""
    _, uncertainty = judged(noisy(1), method=Method.LMS)

    assert uncertainty.band_pct is None
    assert uncertainty.independent_samples is None
    assert uncertainty.creep_per_decade is None
    assert uncertainty.spread_pct.size == noisy(1).t_s.size
    assert np.all(uncertainty.spread_pct >= 0.0)
