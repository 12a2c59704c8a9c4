"""Tests of the drives along one loop that are computed again and again without new arrays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.hysteresis import LearnedModel, ModelForm, StopForm, SurfaceForm
from piezod.hysteresis.path_relaxation import PathRelaxation
from tests.hysteresis.surfaces import Floats, drawn, invertible_with

PATH = PathRelaxation(-0.3, 2.0, 0.1)
RISE = np.linspace(0.0, 1.0, 9)
LOOP = np.concatenate((RISE, RISE[-2::-1]))
STOPS = StopForm.even(5)
KINDS: dict[str, tuple[ModelForm, Floats]] = {
    "stops": (STOPS, STOPS.projected(np.linspace(-0.01, 0.03, 10))),
    "surface": (SurfaceForm(), drawn(3)),
    "path": (SurfaceForm(path=PATH), invertible_with(PATH, drawn(3))),
}
MODELS = st.lists(
    st.tuples(st.floats(0.6, 1.5), st.floats(-0.5, 0.5), st.floats(-0.3, 0.3)),
    min_size=2,
    max_size=4,
)
"""Factors of the weights, offsets and scales."""


@pytest.mark.parametrize("kind", KINDS)
@given(models=MODELS)
def test_drives_are_those_of_the_exact_inverse(
    kind: str, models: list[tuple[float, float, float]]
) -> None:
    """Each model begins relaxed, and gets y = (1 + scale) x - offset, whatever came before."""
    form, weights = KINDS[kind]
    loop = form.loop(LOOP)
    for factor, offset, scale in models:
        y = form.reachable((1.0 + scale) * LOOP - offset)
        expected = form.drives_at(factor * weights, y)

        drives = loop.of(LearnedModel(factor * weights, offset, scale))

        assert drives == pytest.approx(expected, abs=1e-12)


def test_loop_of_a_surface_with_a_lag_is_that_of_slow_motion() -> None:
    """Displacements have no instants here, so that a rate would mean nothing."""
    slow, lagging = (
        form.loop(LOOP).of(LearnedModel(drawn(3)))
        for form in (SurfaceForm(), SurfaceForm(0.01, 0.3, 1e-3))
    )

    assert lagging.tolist() == slow.tolist()
    assert np.max(slow[:8] - slow[:8:-1]) > 0.02  # rising and falling branch
