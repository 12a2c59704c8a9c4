"""Tests of the surface: forward model, memory, inverse, and the proof that the inverse exists."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.errors import ModelError
from piezod.hysteresis.everett import SIZE, surface
from piezod.hysteresis.everett_bounds import least_surface_slope, slope_rows
from piezod.hysteresis.everett_memory import (
    advance_drive,
    displacement,
    displacement_at,
    drive_for,
    new_surface_memory,
)
from piezod.hysteresis.surface_form import SurfaceForm
from tests.hysteresis.surfaces import DRIVES, SURFACES, Floats, all_pairs, drawn, everett, relays

FORM = SurfaceForm()
SLOW = FORM.terms


@given(SURFACES, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_surface_and_slopes_are_those_of_the_series(
    coefficients: Floats, one: float, other: float
) -> None:
    """E agrees with numpy's Legendre series, and the slopes with its differences."""
    upper, lower = max(one, other), min(one, other)
    value, rising, falling = surface(coefficients, upper, lower)

    assert value == pytest.approx(everett(coefficients, upper, lower), abs=1e-13)
    if upper - lower > 0.01 and lower > 0.001 and upper < 0.999:
        step = 1e-6
        up = everett(coefficients, upper + step, lower) - everett(coefficients, upper - step, lower)
        down = everett(coefficients, upper, lower - step) - everett(
            coefficients, upper, lower + step
        )
        assert rising == pytest.approx(up / (2.0 * step), abs=1e-6)
        assert falling == pytest.approx(down / (2.0 * step), abs=1e-6)


@given(SURFACES, DRIVES)
def test_memory_is_the_sum_over_all_pairs(coefficients: Floats, drives: list[float]) -> None:
    """The displacement after any past is the sum over all dominant extrema of that past."""
    positions = FORM.positions_at(coefficients, np.array(drives))

    assert positions[-1] == pytest.approx(all_pairs(coefficients, drives), abs=1e-12)


@given(SURFACES, DRIVES)
def test_stage_is_the_memory_of_regressors(coefficients: Floats, drives: list[float]) -> None:
    """The stage, step by step and at once, agrees with the sum of regressors; NaN holds it."""
    memory, stage = new_surface_memory(), FORM.stage(coefficients)
    at_once = FORM.positions_at(coefficients, np.array(drives))
    for drive, position in zip(drives, at_once.tolist(), strict=True):
        advance_drive(memory, SLOW, 0.0, drive)

        assert stage.step(drive) == position
        assert position == pytest.approx(displacement(coefficients, memory.now), abs=1e-13)
    assert stage.step(float("nan")) == pytest.approx(float(at_once[-1]), abs=1e-13)


@given(SURFACES, st.lists(st.integers(0, 16), min_size=1, max_size=12))
def test_model_is_a_plane_of_relays(coefficients: Floats, levels: list[int]) -> None:
    """At drives on the grid of the plane, relays with the density of E give the same."""
    drives = [level / 16 for level in levels]
    positions = FORM.positions_at(coefficients, np.array(drives))

    assert positions[-1] == pytest.approx(relays(coefficients, drives, 16), abs=1e-12)


@given(SURFACES, DRIVES)
def test_inverse_is_exact_on_every_loop(coefficients: Floats, drives: list[float]) -> None:
    """The drives for the displacements of any drives make these displacements again."""
    positions = FORM.positions_at(coefficients, np.array(drives))
    inverted = FORM.drives_at(coefficients, positions)

    assert FORM.positions_at(coefficients, inverted) == pytest.approx(positions, abs=1e-12)


@given(SURFACES, DRIVES, st.floats(-0.2, 1.2))
def test_drive_for_leaves_the_memory(
    coefficients: Floats, drives: list[float], position: float
) -> None:
    """The search moves nothing, and ends at an end of the range for what no drive reaches."""
    memory = new_surface_memory()
    for drive in drives:
        advance_drive(memory, SLOW, 0.0, drive)
    before = displacement(coefficients, memory.now)
    drive = drive_for(memory, coefficients, SLOW, position)
    there = displacement_at(memory, coefficients, SLOW, drive)

    assert 0.0 <= drive <= 1.0
    assert displacement(coefficients, memory.now) == before
    if drive == 0.0:
        assert there >= position - 1e-12
    elif drive == 1.0:
        assert there <= position + 1e-12
    else:
        assert there == pytest.approx(position, abs=1e-12)
    advance_drive(memory, SLOW, 0.0, drive)
    assert displacement(coefficients, memory.now) == pytest.approx(there, abs=1e-13)


@given(st.integers(0, 10_000), st.floats(0.0, 0.5))
def test_bound_holds_between_the_points_of_a_grid(seed: int, spread: float) -> None:
    """No slope at any random point is below the proven bound, also of surfaces without inverse."""
    rng = np.random.default_rng(seed)
    coefficients = spread * rng.standard_normal(SIZE)
    coefficients[0] += 0.75
    least = least_surface_slope(coefficients)
    pairs = np.sort(rng.random((200, 2)) ** rng.choice([0.2, 1.0, 3.0], (200, 1)), axis=1)
    slopes = [surface(coefficients, upper, lower)[1:] for lower, upper in pairs]

    assert np.min(slopes) >= least - 1e-9


def test_bound_is_close() -> None:
    """The bound of typical surfaces is within 0.3 of the smallest slope on a fine grid."""
    for seed in range(20):
        coefficients = drawn(seed, 0.005)
        grid = np.linspace(0.0, 1.0, 80)
        slopes = [
            surface(coefficients, upper, lower)[1:]
            for upper in grid
            for lower in grid[grid <= upper]
        ]
        assert least_surface_slope(coefficients) > np.min(slopes) - 0.3


def test_rows_are_the_slope_of_a_line() -> None:
    """Displacement in proportion to the drive has the slope one in every row."""
    line = np.zeros(SIZE)
    line[0] = 1.0

    assert slope_rows() @ line == pytest.approx(np.ones(len(slope_rows())), abs=1e-9)


def test_surface_without_inverse_is_refused() -> None:
    """A surface with a falling branch that turns back is refused with its slope."""
    coefficients = np.zeros(SIZE)
    coefficients[0], coefficients[4] = 0.1, 0.9

    with pytest.raises(ModelError, match=r"not monotone.*identify again"):
        FORM.projected(coefficients)
