"""Tests of the displacements that a stage can have at a drive, whatever its past."""

import numpy as np
import pytest
from hypothesis import given, settings

from piezod.hysteresis import StopForm, SurfaceForm
from piezod.hysteresis.path_relaxation import BACKLASH, PathRelaxation
from tests.hysteresis.surfaces import DRIVES, PATHS, SURFACES, Floats, drawn, invertible_with

GRID = np.linspace(0.0, 1.0, 101)
STOPS = StopForm.even(5)


@settings(max_examples=60)
@given(drives=DRIVES, path=PATHS, coefficients=SURFACES)
def test_no_past_leads_beyond_the_path(
    drives: list[float], path: PathRelaxation, coefficients: Floats
) -> None:
    """Any drives from rest change the term within its range, except for the backlash."""
    form, plain = SurfaceForm(path=path), SurfaceForm()
    weights, taken = invertible_with(path, coefficients), np.array(drives)

    changes = form.positions_at(weights, taken) - plain.positions_at(weights, taken)

    low, high = path.range_at(taken)
    left = 2.0 * abs(path.weight) * BACKLASH / (1.0 - abs(path.skew)) + 1e-12
    assert np.all(low - left <= changes)
    assert np.all(changes <= high + left)


@pytest.mark.parametrize("kind", ["stops", "surface"])
def test_range_of_loops_that_close_is_the_widest_one(kind: str) -> None:
    """Both branches of a full swing are its ends, and a swing inside stays between them."""
    form: StopForm | SurfaceForm = STOPS if kind == "stops" else SurfaceForm()
    weights = STOPS.projected(np.linspace(-0.01, 0.03, 10)) if kind == "stops" else drawn(3)
    positions = form.positions_at(weights, np.concatenate((GRID, GRID[::-1])))
    inside = 0.5 + 0.4 * np.sin(np.arange(500) / 9.0) * np.exp(-np.arange(500) / 200.0)

    low, high = form.position_range(weights, GRID)

    assert low == pytest.approx(positions[:101], abs=1e-4)
    assert high == pytest.approx(positions[101:][::-1], abs=1e-4)
    at = form.positions_at(weights, inside)
    assert np.all(np.interp(inside, GRID, low) - 1e-3 <= at)
    assert np.all(at <= np.interp(inside, GRID, high) + 1e-3)


def test_decaying_swing_leads_a_path_below_its_rest() -> None:
    """Small loops leave h near 0, full cycles do not: the rest is lower by most of the range."""
    form = SurfaceForm(path=PathRelaxation(-0.4, 2.1, 0.1))
    weights = invertible_with(PathRelaxation(-0.4, 2.1, 0.1), drawn(3))
    decay = np.linspace(1.0, 0.0, 4001)
    drives = decay * (0.5 - 0.5 * np.cos(40.0 * np.pi * decay))

    rest = form.positions_at(weights, drives)[-1]

    low, _ = form.position_range(weights, np.zeros(1))
    assert low[0] - 1e-3 <= rest < 0.8 * low[0] < -0.1
