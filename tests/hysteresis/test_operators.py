"""The paper's four operators, one by one."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import LSPO, LSSO, RSPO, RSSO, new_bank, stop_regressors
from tests.hysteresis import oracle
from tests.hysteresis.draw import inputs, thresholds

OPERATORS = [RSPO, LSPO, RSSO, LSSO]
THRESHOLD = st.floats(0.01, 0.99)
Inputs = NDArray[np.float64]


@given(r=THRESHOLD, values=inputs())
def test_right_play_follows_the_printed_equation(r: float, values: Inputs) -> None:
    """F^r is paper eq. (2) with the memory of eq. (3), on any input."""
    play = oracle.Play(r, right=True)

    np.testing.assert_allclose(RSPO(r).run(values), [play.step(v) for v in values], atol=1e-12)


@given(r=THRESHOLD, values=inputs())
def test_left_play_follows_the_corrected_equation(r: float, values: Inputs) -> None:
    """F^l is paper eq. (5) with max and min exchanged, on any input."""
    play = oracle.Play(r, right=False)

    np.testing.assert_allclose(LSPO(r).run(values), [play.step(v) for v in values], atol=1e-12)


@pytest.mark.parametrize("r", [0.05, 0.5, 0.95])
def test_plays_deviate_from_the_input_on_one_major_branch_only(r: float) -> None:
    """F^r lags behind while the input rises, F^l while it falls."""
    rising, falling = np.linspace(0, 1, 41), np.linspace(1, 0, 41)
    right, left = RSPO(r), LSPO(r)

    np.testing.assert_allclose(right.run(rising), np.maximum(0, (rising - r) / (1 - r)), atol=1e-15)
    np.testing.assert_allclose(right.run(falling), falling, atol=1e-15)
    np.testing.assert_allclose(left.run(rising), rising, atol=1e-15)
    np.testing.assert_allclose(left.run(falling), np.minimum(1, falling / (1 - r)), atol=1e-15)


@given(r=THRESHOLD, values=inputs())
def test_left_play_is_the_right_one_upside_down(r: float, values: Inputs) -> None:
    """F^l of 1 - v, started at the top, is 1 - F^r of v, started at the bottom."""
    left = LSPO(r)
    left.step(1.0)

    np.testing.assert_allclose(left.run(1 - values), 1 - RSPO(r).run(values), atol=1e-9)


@given(r=THRESHOLD, values=inputs())
def test_each_stop_belongs_to_the_play_of_the_other_side(r: float, values: Inputs) -> None:
    """Paper eq. (12) and (13), corrected: r E^r + (1 - r) F^l = v and r E^l + (1 - r) F^r = v."""
    right = r * RSSO(r).run(values) + (1 - r) * LSPO(r).run(values)
    left = r * LSSO(r).run(values) + (1 - r) * RSPO(r).run(values)

    np.testing.assert_allclose(right, values, atol=1e-12)
    np.testing.assert_allclose(left, values, atol=1e-12)


@given(left=thresholds(most=4), data=st.data())
def test_bank_gives_every_stop_at_once(left: list[float], data: st.DataObject) -> None:
    """The regressors of identification are E - x of single stops, left ones first."""
    right = data.draw(st.lists(THRESHOLD, min_size=len(left), max_size=len(left), unique=True))
    right.sort()
    values = data.draw(inputs())
    stops = [LSSO(r).run(values) for r in left] + [RSSO(r).run(values) for r in right]

    regressors = stop_regressors(new_bank(left, right), values)

    np.testing.assert_allclose(regressors, np.transpose(stops) - values[:, None], atol=1e-9)


@pytest.mark.parametrize("operator", OPERATORS)
def test_reset_operator_starts_anew(operator: Any) -> None:
    """After `reset` an operator gives the outputs of a new one, to the bit."""
    values = np.random.default_rng(1).random(50)
    used = operator(0.3)
    used.run(values)

    used.reset()

    assert used.run(values).tolist() == operator(0.3).run(values).tolist()


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("r", [0.0, 1.0, -0.1, float("nan")])
def test_threshold_outside_the_open_unit_interval_is_refused(operator: Any, r: float) -> None:
    """A threshold of 0 or 1 would cause a division by zero."""
    with pytest.raises(ModelError, match=r"increase strictly inside \(0, 1\)"):
        operator(r)
