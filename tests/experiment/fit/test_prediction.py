"""Tests of predictions: the position from the voltage, and the voltage from the position."""

from dataclasses import replace

import numpy as np
import pytest

from piezod.control.law.creep import logarithmic
from piezod.control.law.model import StageModel
from piezod.experiment.fit.prediction import predicted_um, predicted_v
from piezod.experiment.fit.record import Record
from piezod.hysteresis import AffineRange, SurfaceForm
from piezod.hysteresis.memory import FloatArray
from tests.control.made_up import SURFACE
from tests.experiment.made_up import DRIVE_V, POSITION_UM, swells
from tests.experiment.made_up_surface import all_loops, made_up_surface, surface_record

PERIOD_S = 0.01


def test_lag_with_the_rate_has_the_period_of_the_record() -> None:
    """A hysteresis that lags with the rate is predicted at the rate of the record, both ways."""
    form = SurfaceForm(activation=0.01, prompt_slope=0.3)
    model = StageModel(
        form, made_up_surface(), AffineRange(0.0, 150.0), AffineRange(0.0, 30.0), delay_s=0.0
    )
    t_s: FloatArray = np.arange(2000, dtype=np.float64) * PERIOD_S
    drives: FloatArray = np.clip(all_loops(t_s), 0.0, 1.0)
    position_um = 30.0 * form.sampled(PERIOD_S).positions_at(model.weights, drives)
    record = Record(t_s, 150.0 * drives, position_um)

    assert predicted_um(model, record) == pytest.approx(position_um, abs=1e-9)
    assert predicted_v(model, record) == pytest.approx(record.drive_v, abs=1e-6)


def test_creep_of_an_unknown_past_is_that_which_fits_best() -> None:
    """A record that begins in motion is predicted as one from rest, whatever was before."""
    known = surface_record(weights=SURFACE.weights, drive=swells, creep=0.01, duration_s=50.0)
    model = StageModel(
        SURFACE.form,
        SURFACE.weights,
        AffineRange(0.0, DRIVE_V),
        AffineRange(0.0, POSITION_UM),
        0.0,
        logarithmic(0.01),
    )
    later = known.t_s >= 37.5  # at the lowest drive, after three of its periods
    begun = Record(known.t_s[later], known.drive_v[later], known.position_um[later])

    errors_um = {
        from_rest: predicted_um(model, record) - record.position_um
        for from_rest in (True, False)
        for record in (replace(begun, from_rest=from_rest),)
    }

    worst = {from_rest: np.ptp(each) for from_rest, each in errors_um.items()}
    assert worst[False] < 0.2 * worst[True]
    assert worst[False] < 4e-3 * POSITION_UM
