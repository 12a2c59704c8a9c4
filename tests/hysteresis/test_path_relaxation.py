"""Tests of the part of a surface's displacement that relaxes along the path of the drive."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.hysteresis import SurfaceForm
from piezod.hysteresis.path_relaxation import (
    BACKLASH,
    PathRelaxation,
    risen,
    steepest_relaxation,
)
from piezod.hysteresis.surface_form import branch_slopes, surface_regressors
from tests.hysteresis.surfaces import (
    DRIVES,
    PATHS,
    SURFACES,
    Floats,
    all_pairs,
    invertible_with,
    relaxing,
)

DECAYS, SKEWS = st.floats(0.3, 30.0), st.floats(-0.9, 0.9)
EXPONENTS = st.one_of(st.just(1.0), st.floats(1.0, 4.0))


@given(DECAYS, SKEWS, EXPONENTS, st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_state_solves_its_equation(
    decay: float, skew: float, exponent: float, share: float, rise: float
) -> None:
    """From any state within its saturation h follows the differential equation, and stays there."""
    saturated = 1.0 / (decay * (1.0 + skew))
    start = share * saturated
    h = risen(start, rise, decay * (1.0 + skew), decay * (1.0 - skew), exponent)
    rounding = 1e-7 if exponent == 1.0 else 1e-4 * saturated

    assert h == pytest.approx(relaxing(start, rise, decay, skew, exponent), abs=rounding)
    assert abs(h) <= saturated * (1.0 + 1e-12)


@given(SURFACES, DRIVES, PATHS)
def test_displacement_is_the_sum_of_surface_and_path(
    coefficients: Floats, drives: list[float], path: PathRelaxation
) -> None:
    """After any past it is the sum over all pairs, and w times the change of h since rest."""
    form = SurfaceForm(path=path)
    h, pinned = path.at_rest, 0.0
    for drive in drives:
        moved = drive - pinned
        if abs(moved) > BACKLASH:
            way = moved - np.copysign(BACKLASH, moved)
            h = relaxing(h, way, path.decay, path.skew, path.exponent)
            pinned = drive - np.copysign(BACKLASH, moved)
    expected = all_pairs(coefficients, drives) + path.weight * (h - path.at_rest)

    positions = form.positions_at(coefficients, np.array(drives))

    # Integrated where the exponent is not 1.
    rounding = 1e-7 if path.exponent == 1.0 else 1e-4 * path.reach
    assert positions[-1] == pytest.approx(expected, abs=rounding + 1e-7)


@given(SURFACES, DRIVES, PATHS)
def test_regressors_and_steps_agree_with_the_record(
    coefficients: Floats, drives: list[float], path: PathRelaxation
) -> None:
    """The displacement is linear in coefficients and weight; a stage gives it step by step."""
    form = SurfaceForm(path=path)
    positions = form.positions_at(coefficients, np.array(drives))
    weights = np.array([*coefficients, 0.0, path.weight])
    stage = form.stage(coefficients)

    assert surface_regressors(np.array(drives), form) @ weights == pytest.approx(
        positions, abs=1e-12
    )
    assert [stage.step(drive) for drive in drives] == positions.tolist()


@given(SURFACES, DRIVES, PATHS)
def test_inverse_is_exact_with_a_path(
    coefficients: Floats, drives: list[float], path: PathRelaxation
) -> None:
    """The drives for the displacements of any drives are these drives."""
    form = SurfaceForm(path=path)
    weights = invertible_with(path, coefficients)
    positions = form.positions_at(weights, np.array(drives))

    inverted = form.drives_at(weights, positions)

    assert inverted == pytest.approx(np.array(drives), abs=1e-9)
    assert form.positions_at(weights, inverted) == pytest.approx(positions, abs=1e-12)


@given(SURFACES, DRIVES, PATHS, st.floats(1e-4, 0.05), st.floats(0.0, 1.0))
def test_inverse_is_exact_with_a_path_and_a_lag(
    coefficients: Floats,
    drives: list[float],
    path: PathRelaxation,
    activation: float,
    prompt: float,
) -> None:
    """With both optional terms the drives for displacements make these displacements again."""
    form = SurfaceForm(activation, prompt, 1e-3, path)
    weights = invertible_with(path, coefficients)
    positions = form.positions_at(weights, np.array(drives))
    inverted = form.drives_at(weights, positions)

    assert form.positions_at(weights, inverted) == pytest.approx(positions, abs=1e-9)


@given(SURFACES, DRIVES, PATHS)
def test_bound_holds_on_every_branch(
    coefficients: Floats, drives: list[float], path: PathRelaxation
) -> None:
    """No slope is below the proven one; slopes are those of differences."""
    form = SurfaceForm(path=path)
    slopes = branch_slopes(coefficients, np.array(drives), form)
    *past, last = [0.0, *drives]

    assert np.min(slopes) >= form.smallest_slope(coefficients) - 1e-12
    step = 1e-6 if last > past[-1] else -1e-6
    # A branch has a kink where it passes an earlier turning point.
    if min(abs(last - each) for each in past) > 0.01 and 0.001 < last < 0.999:
        ends = [
            form.positions_at(coefficients, np.array([*past, last + k * step]))[-1] for k in (-1, 1)
        ]
        assert slopes[-1] == pytest.approx((ends[1] - ends[0]) / (2.0 * step), abs=1e-4)


@given(PATHS)
def test_bound_is_reached(path: PathRelaxation) -> None:
    """Just after a turn from saturation a negative weight adds its least slope."""
    line = SurfaceForm().straight_line()
    form = SurfaceForm(path=path)
    saturated = [*np.tile([1.0, 0.0], 200), 2.0 * BACKLASH + 1e-9]

    slope = branch_slopes(line, np.array(saturated), form)[-1]

    at_rest, saturation = path.at_rest, 1.0 / (path.decay * (1.0 + path.skew))
    share = -at_rest / saturation  # a full swing does not saturate a slow state
    steepest = 1.0 + share**path.exponent * (1.0 - path.skew) / (1.0 + path.skew)
    size = abs(path.weight) * steepest_relaxation(path.skew)
    assert slope == pytest.approx(1.0 + path.weight * steepest, abs=1e-3 * size + 1e-9)
    assert form.smallest_slope(line) <= slope + 1e-9


@given(SURFACES, PATHS)
def test_rest_is_after_many_cycles(coefficients: Floats, path: PathRelaxation) -> None:
    """Cycles of the whole range end where they began, at 0 and at the rise of the form."""
    form = SurfaceForm(path=path)
    positions = form.positions_at(coefficients, np.tile([1.0, 0.0], 50))

    size = abs(path.weight) * 10 * BACKLASH
    assert positions[-1] == pytest.approx(0.0, abs=size)
    assert positions[-2] == pytest.approx(form.rise(coefficients), abs=size)
    assert positions[0] == pytest.approx(form.rise(coefficients), abs=1e-12)


def test_noise_of_the_drive_does_not_erase_the_state() -> None:
    """Noise below the backlash leaves the displacement as it is; larger noise does not."""
    path = PathRelaxation(-0.3, 2.0, 0.1)
    form, line = SurfaceForm(path=path), SurfaceForm().straight_line()
    signs = np.tile([1.0, -1.0], 50_000)
    moved = [
        form.positions_at(line, np.concatenate(([0.5], 0.5 + size * signs, [0.5])))
        for size in (0.99 * BACKLASH, 3.0 * BACKLASH)
    ]

    quiet, loud = (abs(float(each[-1] - each[0])) for each in moved)
    assert quiet < 1e-4
    assert loud > 0.01


def test_loops_do_not_close_at_once() -> None:
    """Small cycles in the middle of a large loop drift toward the middle, by less each time."""
    path = PathRelaxation(-0.3, 2.0, 0.1)
    form, line = SurfaceForm(path=path), SurfaceForm().straight_line()
    positions = form.positions_at(line, np.array([0.5, *np.tile([0.6, 0.5], 40)]))[::2]

    drifts = np.abs(np.diff(positions))
    assert drifts[0] > 0.005
    assert np.all(np.diff(drifts[:20]) < 0.0)
