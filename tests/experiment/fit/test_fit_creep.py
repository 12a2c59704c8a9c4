"""Tests of creep, delay and offset that are fitted together with the weights."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.errors import DataError
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.method import Spacing
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.hysteresis import LEAST_SLOPE
from piezod.hysteresis.memory import FloatArray
from tests.experiment.made_up import (
    LEFT_WEIGHTS,
    ORDER,
    POSITION_UM,
    RATE_HZ,
    RIGHT_WEIGHTS,
    record_of,
    sine,
    swells,
)

CREEP = 0.006
"""Weight of each lag: 1.2 % per decade, as in piezo ceramics."""


def fitted(record: Record, *, creep: bool = True, delay_s: float | None = 0.0) -> Fit:
    """Fit a model of the stage's own order, by default with creep and without delay."""
    return fit_model(record, FitSettings(order=ORDER, creep=creep, delay_s=delay_s))


def creep_of(fit: Fit) -> float:
    """Return the weight of each lag; all are equal."""
    weights = fit.model.creep.weights
    assert np.array_equal(fit.model.creep.time_constants_s, TIME_CONSTANTS_S)
    assert np.ptp(weights) == 0.0
    return float(weights[0])


@pytest.mark.parametrize("noise", [0.0, 5e-4])
@pytest.mark.parametrize("creep", [CREEP / 2, 2 * CREEP])
def test_creep_and_delay_are_found_together(creep: float, noise: float) -> None:
    """Creep looks like a longer delay, and conversely; both are found."""
    record = record_of(path=swells, duration_s=60.0, delay_periods=2.34, creep=creep, noise=noise)

    fit = fitted(record, delay_s=None)

    assert creep_of(fit) == pytest.approx(creep, rel=0.04)  # samples miss the ends of the range
    assert fit.model.delay_s * RATE_HZ == pytest.approx(2.34, abs=0.03)
    assert fit.model.weights == pytest.approx([*LEFT_WEIGHTS, *RIGHT_WEIGHTS], abs=4e-3)
    assert fit.model.position_um.low == pytest.approx(0.0, abs=0.03)
    assert fit.model.position_um.high == pytest.approx(POSITION_UM, abs=0.045)


def test_creep_that_is_not_there_is_not_found() -> None:
    """A stage without creep gets almost none, and the other parameters stay."""
    record = record_of(path=swells, duration_s=40.0, noise=5e-4)

    fit, plain = fitted(record), fitted(record, creep=False)

    assert np.sum(fit.model.creep.weights) < 0.002
    assert fit.model.weights == pytest.approx(plain.model.weights, abs=3e-3)


def test_creep_is_fitted_only_on_request() -> None:
    """Without it the model has none, and predicts worse."""
    record = record_of(path=swells, duration_s=40.0, creep=CREEP)

    fit, plain = fitted(record), fitted(record, creep=False)

    assert plain.model.creep.weights.size == 0
    errors = [f.errors_pct(record)["voltage_error_rms_pct"] for f in (fit, plain)]
    assert errors[0] < 0.05
    assert errors[1] > 5.0 * errors[0]


def test_creep_carries_over_to_another_record() -> None:
    """Creep from loops predicts a staircase of half a minute."""

    def stairs(t_s: FloatArray) -> FloatArray:
        smooth = np.clip((t_s % 5.0) / 0.5, 0.0, 1.0)
        return 0.2 * np.minimum(np.floor(t_s / 5.0) + smooth, 5.0)

    fit = fitted(record_of(path=swells, duration_s=60.0, creep=CREEP))
    held = record_of(path=stairs, duration_s=30.0, creep=CREEP)

    without = replace(fit, model=replace(fit.model, creep=fitted(held, creep=False).model.creep))

    assert fit.errors_pct(held)["voltage_error_max_pct"] < 0.3
    assert without.errors_pct(held)["voltage_error_max_pct"] > 2.0


@pytest.mark.parametrize("drift", [-0.01, 0.01])
def test_offset_from_the_run_in_is_found(drift: float) -> None:
    """A drift before the samples that count only moves the range."""
    record = record_of(path=swells, duration_s=60.0, creep=CREEP)
    drift_um = drift * POSITION_UM * np.minimum(record.t_s / 5.0, 1.0)

    fit = fitted(replace(record, position_um=record.position_um + drift_um, run_in_s=12.5))

    assert fit.model.position_um.low == pytest.approx(drift * POSITION_UM, abs=0.05 * 0.3)
    assert creep_of(fit) == pytest.approx(CREEP, rel=0.05)


def test_range_of_a_drifting_stage_is_that_of_its_samples() -> None:
    """Position errors stay small: the voltage alone would allow a range that is 1 % too large."""
    record = record_of(path=sine, duration_s=40.0, creep=CREEP, noise=5e-4)
    drift_um = 0.01 * POSITION_UM * -np.expm1(-record.t_s / 10.0)
    drifting = replace(record, position_um=record.position_um + drift_um, run_in_s=2.5)
    settings = FitSettings(order=30, spacing=Spacing.GRADED, creep=True, delay_s=0.0)

    errors = fit_model(drifting, settings).errors_pct(drifting)

    assert errors["voltage_error_rms_pct"] < 0.15
    assert errors["position_error_rms_pct"] < 0.15
    assert errors["position_error_max_pct"] < 0.6


def test_creep_of_a_record_that_does_not_start_at_rest() -> None:
    """Its past is assumed like the record; assuming a rest gives a wrong creep."""
    whole = record_of(path=swells, duration_s=76.0, creep=CREEP)
    later = slice(1312, None)
    cut = Record(whole.t_s[later], whole.drive_v[later], whole.position_um[later], run_in_s=12.5)

    in_the_middle, at_rest = (
        creep_of(fitted(replace(cut, from_rest=from_rest))) for from_rest in (False, True)
    )

    assert in_the_middle == pytest.approx(CREEP, rel=0.25)
    assert abs(in_the_middle - CREEP) < abs(at_rest - CREEP)


@pytest.mark.parametrize("spacing", list(Spacing))
@pytest.mark.few(1)
def test_creep_is_found_for_any_thresholds(spacing: Spacing) -> None:
    """The hysteresis absorbs little of it."""
    record = record_of(path=swells, duration_s=60.0, creep=CREEP)

    fit = fit_model(record, FitSettings(order=19, spacing=spacing, creep=True, delay_s=0.0))

    assert creep_of(fit) == pytest.approx(CREEP, rel=0.05)


@settings(max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1),
    exponent=st.floats(0.2, 5.0),
    noise=st.floats(0.0, 0.5),
    creep=st.booleans(),
    spacing=st.sampled_from([Spacing.EVEN, Spacing.GRADED]),
)
def test_every_fit_can_be_inverted(
    seed: int, exponent: float, noise: float, creep: bool, spacing: Spacing
) -> None:
    """For any record the inverse exists on every loop."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(2000) / RATE_HZ
    position = swells(t_s)
    drive = position**exponent + noise * rng.normal(size=t_s.size)
    record = Record(t_s, drive, position)

    try:
        fit = fit_model(record, FitSettings(order=ORDER, spacing=spacing, creep=creep, delay_s=0.0))
    except DataError:  # there is no creep like that
        reject()

    assert fit.smallest_slope >= LEAST_SLOPE - 1e-12


def test_more_creep_than_a_stage_can_have_is_refused() -> None:
    """Lags that add up to nearly the whole displacement are no creep."""
    record = record_of(creep=0.15, duration_s=12.0)

    with pytest.raises(DataError, match="no creep could be fitted: the search went to"):
        fit_model(record, FitSettings(order=ORDER, creep=True, delay_s=0.0))
