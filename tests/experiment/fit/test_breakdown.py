"""Tests of the parts of a residual."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from piezod.experiment.fit.errors import Breakdown, breakdown_of, judge
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.warnings import residual_warnings
from piezod.hysteresis.memory import FloatArray
from tests.experiment.made_up import POSITION_UM, sine
from tests.experiment.made_up_surface import surface_record


def two_rates(t_s: FloatArray) -> FloatArray:
    """Return full swings of 0.25 Hz, and from the middle on of 2.5 Hz; (n,) for (n,) in s."""
    middle_s = t_s[t_s.size // 2]
    frequency_hz = np.where(t_s < middle_s, 0.25, 2.5)
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * frequency_hz * t_s))


RECORD = surface_record(drive=two_rates, duration_s=40.0)
SETTINGS = FitSettings(method=Method.SURFACE, creep=False, delay_s=0.0)


@cache
def good_fit() -> Fit:
    """Return the fit to the record."""
    return fit_model(RECORD, SETTINGS)


def parts_with(added_pct: FloatArray) -> Breakdown:
    """Return the parts of the residual of a record to which something is added, in % of 30 µm."""
    position_um = RECORD.position_um - 0.01 * POSITION_UM * added_pct
    return breakdown_of(good_fit(), replace(RECORD, position_um=position_um))


def rms(values: FloatArray) -> float:
    """Return the rms without the mean."""
    return float(np.std(values))


def test_a_good_model_leaves_nothing() -> None:
    """All parts are small."""
    parts = parts_with(np.zeros(RECORD.t_s.size))

    assert parts.total_pct < 0.05
    assert (parts.vibration_pct, parts.vibration_hz) == (0.0, None)


def test_drift_is_found_at_the_return_points() -> None:
    """A shift of the zero over the record is drift, and its range is that of the shift."""
    drift_pct = 2.0 * RECORD.t_s / RECORD.t_s[-1]
    parts = parts_with(drift_pct)

    assert parts.return_point_drift_pct == pytest.approx(2.0, rel=0.15)
    assert parts.drift_pct == pytest.approx(rms(drift_pct), rel=0.1)
    assert parts.rest_pct < 0.2 * parts.total_pct


def test_loops_that_widen_with_the_rate_are_found() -> None:
    """The widening per decade is that of the record; the drift of the zero does not count."""
    drive = RECORD.drive_v / RECORD.drive_v.max()
    rising = np.sign(np.gradient(drive))
    fast = np.where(RECORD.t_s < 20.0, -0.5, 0.5)
    # Fast loops are wider by 1 % than slow ones: 0.5 % on either side of the middle.
    added_pct = rising * fast * 0.5 * 4.0 * drive * (1.0 - drive)
    parts = parts_with(added_pct)

    assert parts.widening_pct == pytest.approx(1.0, rel=0.15)
    assert parts.rate_pct == pytest.approx(rms(added_pct), rel=0.1)
    assert parts.rest_pct < 0.3 * parts.total_pct


def test_vibration_and_noise_are_told_apart() -> None:
    """A line that the drive does not have is a vibration; white noise is not."""
    noise_pct = 0.3 * np.random.default_rng(1).standard_normal(RECORD.t_s.size)
    line_pct = 0.5 * np.sin(2.0 * np.pi * 31.0 * RECORD.t_s)
    noisy, both = parts_with(noise_pct), parts_with(noise_pct + line_pct)

    assert (noisy.vibration_pct, noisy.vibration_hz) == (0.0, None)
    assert noisy.noise_pct == pytest.approx(0.3, rel=0.1)
    assert both.vibration_hz == pytest.approx(31.0, rel=0.02)
    assert both.vibration_pct == pytest.approx(rms(line_pct), rel=0.1)
    assert both.noise_pct == pytest.approx(0.3, rel=0.1)
    assert both.rest_pct < 0.3 * both.total_pct


def test_one_rate_shows_no_widening() -> None:
    """If all swings have one rate, nothing is known of it."""
    record = surface_record(drive=sine, duration_s=20.0)

    assert breakdown_of(fit_model(record, SETTINGS), record).widening_pct is None


def drifting(per_s: float, noise: float = 0.0) -> Record:
    """Return the record with a gain that grows by this share per second, and noise."""
    noise_um = POSITION_UM * noise * np.random.default_rng(1).standard_normal(RECORD.t_s.size)
    return replace(RECORD, position_um=RECORD.position_um * (1.0 + per_s * RECORD.t_s) + noise_um)


@pytest.mark.parametrize(
    ("per_s", "noise"), [(0.001, 0.0), (-0.0002, 0.002), (-0.0005, 0.002), (-0.001, 0.003)]
)
@pytest.mark.few(2)
def test_drift_is_not_taken_for_a_lag_with_the_rate(per_s: float, noise: float) -> None:
    """Rate and gain change together, so that a lag helps most blocks; the others become worse."""
    assert fit_model(drifting(per_s, noise), SETTINGS).rate_lag == 0.0


def test_drift_that_makes_the_error_has_a_warning() -> None:
    """The warning says what record would tell more; without drift there is none."""
    warnings = []
    for record in (RECORD, drifting(0.002)):
        fit = fit_model(record, SETTINGS)
        warnings.append(
            tuple(residual_warnings(judge(fit, record, None), breakdown_of(fit, record)))
        )

    assert warnings[0] == ()
    (warning,) = warnings[1]
    assert warning.startswith("The return points drift by 7.2 %")
    assert "longer run-in" in warning
    assert warning.endswith(
        "with --skip-s, and fit creep. If they drift until the end, the gain or the zero of the "
        "stage or of its sensor drifts: `adaptive` follows both."
    )


def test_widening_that_makes_the_error_has_a_warning() -> None:
    """The warning asks for a record at the rates at which the stage is used."""
    parts = replace(
        parts_with(np.zeros(RECORD.t_s.size)), total_pct=0.6, rate_pct=0.5, widening_pct=2.0
    )

    (warning,) = residual_warnings(judge(good_fit(), RECORD, None), parts)

    assert warning.startswith("The loops widen by 2 % of the swing per decade of the rate")
