"""Tests of the form of a model of hysteresis: what control and experiments ask of it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import LEAST_SLOPE, StopForm, even_thresholds, new_bank
from piezod.hysteresis.bank import GAINS

FORM = StopForm(new_bank([0.1, 0.3, 0.8], [0.15, 0.4, 0.9]))
WEIGHTS = np.array([0.05, 0.02, 0.04, 0.03, 0.06, 0.01])


def path() -> NDArray[np.float64]:
    """Return displacements in [0, 1] from rest, with loops inside loops, shape (n,)."""
    t = np.linspace(0.0, 8.0, 1500)
    return 0.5 - 0.25 * np.cos(2.0 * np.pi * t) * (1.0 + np.exp(-t)) / 2.0 - 0.25 * np.exp(-t)


def test_even_stops_have_even_thresholds() -> None:
    """Both sides of the form have the thresholds of the paper."""
    thresholds = even_thresholds(4)

    form = StopForm.even(4)

    assert np.array_equal(form.bank, new_bank(thresholds, thresholds))
    assert form.size == 8


def test_drives_are_those_of_the_inverse_model() -> None:
    """The sum over the operators is the closed form of the inverse model."""
    x = path()

    assert FORM.drives_at(WEIGHTS, x) == pytest.approx(FORM.inverse(WEIGHTS).run(x), abs=1e-12)


def test_reversal_within_the_deadband_moves_no_operator() -> None:
    """The drive then falls with the slope 1 + Σ a g, as far as the displacement falls."""
    x = np.array([0.2, 0.5, 0.46])

    drives = FORM.drives_at(WEIGHTS, x, 0.1)

    slope = 1.0 + float(WEIGHTS @ FORM.bank[GAINS])
    assert drives[2] - drives[1] == pytest.approx(slope * (x[2] - x[1]), abs=1e-12)


def test_displacements_are_those_that_need_the_drives() -> None:
    """From the relaxed state, displacements and drives give each other back."""
    x = path()

    assert FORM.positions_at(WEIGHTS, FORM.drives_at(WEIGHTS, x)) == pytest.approx(x, abs=1e-12)


def test_stage_makes_the_displacements_step_by_step() -> None:
    """A stage that is driven step by step moves as over the whole record, to the bit."""
    drives = FORM.drives_at(WEIGHTS, path())
    stage = FORM.stage(WEIGHTS)

    stepped = [stage.step(drive) for drive in drives.tolist()]

    assert stepped == FORM.positions_at(WEIGHTS, drives).tolist()


def test_stage_of_a_model_without_an_inverse_is_refused() -> None:
    """No stage moves against its drive."""
    with pytest.raises(ModelError, match="no inverse exists"):
        FORM.stage(-20.0 * WEIGHTS)


def test_widest_loop_has_the_drives_of_a_full_swing() -> None:
    """Its branches are the drives up and down again, at the same displacements."""
    x = np.linspace(0.0, 1.0, 50)
    drives = FORM.drives_at(WEIGHTS, np.concatenate((x, x[::-1])))

    up, down = FORM.widest_loop(WEIGHTS, x)

    assert up == pytest.approx(drives[:50], abs=1e-12)
    assert down == pytest.approx(drives[50:][::-1], abs=1e-12)
    assert np.all(up[1:-1] > down[1:-1])


def test_projected_weights_have_an_inverse() -> None:
    """Weights without an inverse are moved to the least slope; others stay as they are."""
    bad = -20.0 * WEIGHTS

    assert FORM.smallest_slope(bad) < 0.0
    assert FORM.smallest_slope(FORM.projected(bad)) == pytest.approx(LEAST_SLOPE, abs=1e-6)
    assert np.array_equal(FORM.projected(WEIGHTS), WEIGHTS)


def test_records_have_the_right_stops_first() -> None:
    """One row or many: the halves change places."""
    rows = np.stack((WEIGHTS, 2.0 * WEIGHTS))

    assert FORM.two_sided
    assert FORM.as_recorded(WEIGHTS).tolist() == [0.03, 0.06, 0.01, 0.05, 0.02, 0.04]
    assert np.array_equal(FORM.as_recorded(rows)[1], 2.0 * FORM.as_recorded(WEIGHTS))
