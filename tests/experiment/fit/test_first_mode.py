"""Tests of the first mode in the fit of a surface."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from piezod.config.first_mode import FirstModeConfig
from piezod.config.model_file import dump_model
from piezod.control.law.first_mode import FirstMode
from piezod.control.law.model_files import read_model
from piezod.experiment.fit.errors import cross_validate
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.fit_numbers import parameters_of
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.model_io import to_model_file
from piezod.experiment.fit.prediction import predicted_um
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.uncertainty import uncertainty_of
from piezod.experiment.fit.warnings import fit_warnings, mode_warnings
from tests.experiment.fit.made_up_ringing import MODE, RATE_HZ, ringing_record
from tests.experiment.made_up_surface import surface_record

SURFACE = FitSettings(method=Method.SURFACE)
HALF_PERIOD_S = 0.5 / RATE_HZ
"""A held drive is half a period later than the same drive by linear interpolation."""


@pytest.fixture(scope="module")
def fit() -> Fit:
    """Return the fit to a record that rings."""
    return fit_model(ringing_record(duration_s=2.0), SURFACE)


@pytest.mark.parametrize(
    ("seed", "duration_s"),
    [(1, 2.0), *(pytest.param(seed, 4.0, marks=pytest.mark.stress) for seed in (1, 2))],
)
@pytest.mark.parametrize(
    ("mode", "delay_s"),
    [
        pytest.param(MODE, 0.0011, marks=pytest.mark.stress),
        pytest.param(MODE._replace(lag_s=5e-4), 0.0011, marks=pytest.mark.stress),
        pytest.param(FirstMode(60.0, 0.2), 0.0, marks=pytest.mark.stress),
        (FirstMode(430.0, 0.008), 0.0003),
    ],
)
def test_mode_is_found_within_its_uncertainty(
    seed: int, duration_s: float, mode: FirstMode, delay_s: float
) -> None:
    """They come back together with delay and lag, and the errors are those of the noise.

    Without the lag in the fit, the damping of the second mode would be 0.032 in place of 0.03.
    """
    record = ringing_record(mode=mode, delay_s=delay_s, seed=seed, duration_s=duration_s)

    fit = fit_model(record, SURFACE)

    validation = cross_validate(fit)
    half = uncertainty_of(fit, validation).mode
    found = fit.model.mode
    assert found is not None
    assert half is not None
    assert abs(found.frequency_hz - mode.frequency_hz) < half.frequency_hz
    assert abs(found.damping - mode.damping) < half.damping
    if mode.lag_s:
        assert abs(found.lag_s - mode.lag_s) < half.lag_s < 0.2 * mode.lag_s
    assert half.frequency_hz < 0.02 * mode.frequency_hz
    assert half.damping < 0.2 * mode.damping
    assert fit.model.delay_s == pytest.approx(delay_s + HALF_PERIOD_S, abs=2e-5)
    assert validation.position_rms_pct < 0.15


def test_another_drive_is_predicted(fit: Fit) -> None:
    """The mode makes the error of the position on another drive smaller by factors."""
    other = ringing_record(seed=5, held_s=0.02, duration_s=2.0)

    errors = fit.errors_pct(other)

    error_um = predicted_um(replace(fit.model, mode=None), other) - other.position_um
    without_pct = 100.0 * np.std(error_um) / fit.model.position_um.width
    assert errors["position_error_rms_pct"] < 0.2
    assert without_pct > 5.0
    assert errors["voltage_error_rms_pct"] < 0.5


@pytest.mark.parametrize("duration_s", [2.0, pytest.param(4.0, marks=pytest.mark.stress)])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_slow_record_shows_no_mode(noise: float, duration_s: float) -> None:
    """A drive without jumps does not make the stage ring: the model has no mode, and says none."""
    fit = fit_model(ringing_record(held_s=0.0, noise=noise, duration_s=duration_s), SURFACE)

    assert fit.model.mode is None
    assert fit.shows_mode is None
    assert fit.settings.smoothing
    assert uncertainty_of(fit, cross_validate(fit)).mode is None


def test_stage_without_a_mode_shows_none() -> None:
    """Neither a delay nor creep is taken for a mode."""
    fit = fit_model(
        surface_record(delay_s=0.006, creep=0.005, noise=1e-3), replace(SURFACE, creep=True)
    )

    assert fit.model.mode is None


def test_filter_of_the_sensor_is_no_mode() -> None:
    """A motion that does not ring is no first mode."""
    fit = fit_model(ringing_record(mode=FirstMode(180.0, 0.7), duration_s=2.0), SURFACE)

    assert fit.model.mode is None


def test_fit_reports_how_clearly_the_mode_is_shown(fit: Fit) -> None:
    """The vibration is not smoothed, and the errors on held-out blocks compare both fits."""
    assert fit.shows_mode is not None
    assert fit.shows_mode.with_pct < 0.15
    assert fit.shows_mode.without_pct > 20 * fit.shows_mode.with_pct
    assert not fit.settings.smoothing
    assert not tuple(fit_warnings(fit, fit.record.period_s))


@pytest.mark.stress
def test_loops_of_a_ringing_record_are_those_of_its_drive() -> None:
    """A vibration has swings of all sizes, but a drive of two levels shows one loop."""
    fit = fit_model(ringing_record(two_levels=True, duration_s=2.0), SURFACE)

    (warning,) = fit_warnings(fit, fit.record.period_s)

    assert fit.model.mode is not None
    assert warning.startswith("The record does not have loops of all sizes and heights.")


def test_model_file_keeps_the_mode(tmp_path: Path, fit: Fit) -> None:
    """The entry is optional; it comes back to the bit, and the account has it."""
    source, path = tmp_path / "data.csv", tmp_path / "model.yaml"
    source.touch()
    file = to_model_file(fit, source, fit.errors_pct(fit.record), datetime(2024, 5, 1, tzinfo=UTC))
    path.write_text(dump_model(file), encoding="utf-8")
    without = dump_model(file.model_copy(update={"first_mode": None}))

    model, _ = read_model(path)

    assert model.mode is not None
    assert model.mode == fit.model.mode
    assert parameters_of(model)["first_mode_damping"] == model.mode.damping
    assert "first_mode" not in without
    path.write_text(without, encoding="utf-8")
    assert read_model(path)[0].mode is None


@pytest.mark.parametrize(
    ("configured", "text"),
    [
        (None, "The configuration has none, so that the loop uses it with this model, unless "),
        (FirstModeConfig(frequency_hz=150.0, damping=0.03), "has 150 Hz and 0.03"),
        (FirstModeConfig(frequency_hz=180.0, damping=0.05), "has 180 Hz and 0.05"),
        (FirstModeConfig(frequency_hz=180.5, damping=0.031), None),
    ],
)
def test_mode_that_is_not_the_configured_one_has_a_warning(
    configured: FirstModeConfig | None, text: str | None
) -> None:
    """The difference is beyond the uncertainty, and so large that it matters."""
    half = FirstMode(frequency_hz=0.1, damping=1e-4)

    warnings = tuple(mode_warnings(MODE, half, configured))

    if text is None:
        assert warnings == ()
    else:
        (warning,) = warnings
        assert "at 180 ± 0.1 Hz with a damping ratio of 0.03 ± 0.0001" in warning
        assert text in warning
