"""Creep on top of hysteresis: its law, its exact removal, and its bounds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import NO_CREEP, Creep, add_creep, remove_creep
from piezod.hysteresis.creep import advance_creep
from tests.hysteresis.draw import inputs

Array = NDArray[np.float64]

TIME_CONSTANTS = np.logspace(-1.5, 2, 8)  # s


def creep(weight: float = 0.01, dt: float = 1e-3) -> Creep:
    """Return a creep of equal weights, two time constants a decade, sampled every dt seconds."""
    return Creep(np.full(8, weight), 1.0 - np.exp(-dt / TIME_CONSTANTS))


@st.composite
def creeps(draw: st.DrawFn) -> Creep:
    """Draw any number of lags whose weights come to less than one."""
    count = draw(st.integers(0, 6))
    parts = draw(st.lists(st.floats(0, 1), min_size=count, max_size=count))
    gains = draw(st.lists(st.floats(1e-6, 1), min_size=count, max_size=count))
    return Creep(0.9 * np.array(parts) / max(count, 1), np.array(gains))


@given(creep=creeps(), y=inputs(), start=st.floats(0, 1))
def test_removing_creep_undoes_adding_it(creep: Creep, y: Array, start: float) -> None:
    """From the same state of the lags, the displacement comes back up to rounding."""
    there, back = (np.full(creep.gains.size, start) for _ in range(2))

    x = add_creep(creep, y, there, start)

    np.testing.assert_allclose(remove_creep(creep, x, back, start), y, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back, there, rtol=0, atol=1e-12)


@given(creep=creeps(), y=inputs(least=2), cut=st.integers(1, 39))
def test_records_can_be_cut_anywhere(creep: Creep, y: Array, cut: int) -> None:
    """Lags and the last displacement hold the whole state, to the bit."""
    lags, whole = np.zeros(creep.gains.size), np.zeros(creep.gains.size)

    first = remove_creep(creep, y[:cut], lags)
    rest = remove_creep(creep, y[cut:], lags, first[-1])

    assert [*first, *rest] == remove_creep(creep, y, whole).tolist()
    assert lags.tolist() == whole.tolist()


def test_step_creeps_by_the_same_in_each_decade() -> None:
    """Two lags a decade of equal weight add twice that weight per decade, to 10 %."""
    y = np.ones(20_000)
    y[0] = 0.0

    x = add_creep(creep(0.01), y, np.zeros(8))

    decades = x[[200, 2000, 20_000 - 1]] - x[[20, 200, 2000]]
    np.testing.assert_allclose(decades, 0.02, rtol=0.1)


def test_rest_settles_at_the_sum_of_all_weights() -> None:
    """Long after the longest time constant x = (1 + Σ w) y, and removing the creep gives y."""
    slow = creep(0.01, dt=10.0)

    x = add_creep(slow, np.full(1000, 0.5), np.zeros(8))

    assert x[-1] == pytest.approx(0.54, abs=1e-12)
    assert remove_creep(slow, x, np.zeros(8))[-1] == pytest.approx(0.5, abs=1e-12)


def test_lags_follow_the_displacement_of_the_sample_before() -> None:
    """A step creeps first one sample later, by the first gain of each lag."""
    one = Creep(np.array([0.1]), np.array([0.25]))

    x = add_creep(one, [1.0, 1.0, 1.0], np.zeros(1))

    np.testing.assert_allclose(x, [1.0, 1.025, 1.04375], rtol=0, atol=1e-15)


def test_without_lags_there_is_no_creep() -> None:
    """The displacement passes unchanged."""
    y = [0.0, 0.3, 0.2]

    assert add_creep(NO_CREEP, y, np.zeros(0)).tolist() == y
    assert remove_creep(NO_CREEP, y, np.zeros(0)).tolist() == y


@pytest.mark.parametrize("failed", [float("nan"), float("inf"), -float("inf")])
def test_displacement_that_is_not_finite_moves_no_lag(failed: float) -> None:
    """A failed measurement leaves the state of the lags as it is."""
    lags = np.array([0.2])

    crept = advance_creep(lags, np.array([0.5]), np.array([0.1]), failed)

    assert crept == pytest.approx(0.02)
    assert lags.tolist() == [0.2]


def test_positions_have_one_dimension() -> None:
    """A two-dimensional array of positions is refused."""
    with pytest.raises(ModelError, match="one dimension"):
        remove_creep(NO_CREEP, [[0.0]], np.zeros(0))
