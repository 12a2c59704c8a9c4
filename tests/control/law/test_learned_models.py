"""Tests of the measure of D5: drives of the learned model against those of the identified one."""

from collections.abc import Callable

import numpy as np
import pytest

from piezod.control.law.learned_models import ModelDrift
from piezod.control.law.model import StageModel
from piezod.hysteresis import AffineRange, LearnedModel, ModelForm, StopForm, SurfaceForm
from tests.hysteresis.surfaces import Floats, drawn

STOPS = StopForm.even(5)
FINE = np.linspace(0.0, 1.0, 401)
BETWEEN_LEVELS = 0.06
"""Just after the turn the difference may have a peak between two displacements."""


def stage_model(form: ModelForm, weights: Floats) -> StageModel:
    """Return a model of a stage."""
    return StageModel(form, weights, AffineRange(0.0, 150.0), AffineRange(0.0, 30.0), 0.0)


STOP_MODEL = stage_model(STOPS, STOPS.projected(np.linspace(-0.01, 0.03, 10)))
SURFACE_MODEL = stage_model(SurfaceForm(), drawn(3))


def difference(model: StageModel, weights: Floats) -> float:
    """Return the largest difference of the drives on 401 displacements of the widest loop."""
    loops = (
        np.concatenate(model.form.widest_loop(each, FINE)) for each in (model.weights, weights)
    )
    one, other = loops
    return float(np.max(np.abs(one - other)))


@pytest.mark.parametrize("gain", [0.6, 0.75, 0.9, 1.0, 1.1, 1.2, 1.3, 1.45])
def test_gain_of_a_surface_is_measured_by_its_drives(gain: float) -> None:
    """A stage whose gain has grown needs less drive, one that has lost gain the whole range."""
    learned = LearnedModel(gain * SURFACE_MODEL.weights)

    measured = ModelDrift(SURFACE_MODEL).measure(learned)

    expected = difference(SURFACE_MODEL, learned.weights)
    assert expected - BETWEEN_LEVELS <= measured <= expected + 1e-12
    assert (measured == 0.0) == (gain == 1.0)


@pytest.mark.parametrize(
    ("model", "changed"),
    [
        (STOP_MODEL, lambda weights: weights + np.linspace(0.02, -0.02, weights.size)),
        (SURFACE_MODEL, lambda weights: weights + 0.5 * (drawn(8) - weights)),
    ],
    ids=["stops", "surface"],
)
def test_change_of_shape_is_measured(
    model: StageModel, changed: Callable[[Floats], Floats]
) -> None:
    """The measure is the largest difference on the loop."""
    learned = LearnedModel(model.form.projected(changed(model.weights)))

    expected = difference(model, learned.weights)

    assert expected > 3e-3
    assert ModelDrift(model).measure(learned) == pytest.approx(expected, abs=0.1 * expected)


@pytest.mark.parametrize("model", [STOP_MODEL, SURFACE_MODEL], ids=["stops", "surface"])
@pytest.mark.parametrize("offset", [-0.2, 0.2])
def test_offset_counts_with_the_slope_of_the_loop(model: StageModel, offset: float) -> None:
    """Inside the range the drives move by about the offset; the measure follows what is learned."""
    learned = LearnedModel(model.weights.copy())
    drift = ModelDrift(model)
    before = drift.measure(learned)

    learned.offset = offset

    assert before == 0.0
    assert drift.measure(learned) == pytest.approx(abs(offset), rel=0.35)
