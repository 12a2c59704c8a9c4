"""The closed form against the operators that it replaces, and general properties of hysteresis."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.hysteresis import (
    InverseMPI,
    MPIModel,
    even_thresholds,
    new_bank,
    stop_regressors,
)
from tests.hysteresis.draw import (
    UNIT,
    Sides,
    any_sides,
    dense,
    inputs,
    model,
    slow_model,
    thresholds,
    weights,
)

Inputs = NDArray[np.float64]


@given(sides=any_sides(), values=inputs())
def test_closed_form_is_the_sum_of_the_operators(sides: Sides, values: Inputs) -> None:
    """One scalar per loop gives the sum of all operators, for weights of either sign."""
    np.testing.assert_allclose(model(sides).run(values), slow_model(sides).run(values), atol=1e-11)


@given(sides=any_sides(), values=inputs())
def test_depth_is_the_number_of_extrema_that_still_matter(sides: Sides, values: Inputs) -> None:
    """After every sample the memory has the same depth as two plain lists."""
    fast, slow = model(sides), slow_model(sides)
    for value in values:
        fast.step(value)
        slow.step(value)

        assert fast.depth == slow.depth


@given(left=thresholds(), right=thresholds(), data=st.data())
def test_inverse_in_closed_form_is_the_sum_of_stops(
    left: list[float], right: list[float], data: st.DataObject
) -> None:
    """The kernel of the forward model computes paper eq. (16); right stops belong to left plays."""
    a_left = data.draw(weights(len(left)))
    a_right = data.draw(weights(len(right)))
    values = data.draw(inputs())
    # A bank has as many left as right stops: the shorter side gets stops of weight 0.
    size = max(len(left), len(right))
    spare = [0.995 + 1e-4 * j for j in range(size)]
    bank = new_bank([*left, *spare][:size], [*right, *spare][:size])
    all_weights = [*a_left, *[0.0] * (size - len(left)), *a_right, *[0.0] * (size - len(right))]
    inverse = InverseMPI(right, left, a_right, a_left, capacity=64)

    z = values + stop_regressors(bank, values) @ np.array(all_weights)

    np.testing.assert_allclose(inverse.run(values), z, atol=1e-9)


@given(sides=any_sides(), points=inputs(least=2, most=15))
def test_model_does_not_depend_on_the_rate(sides: Sides, points: Inputs) -> None:
    """Rate independence: dense and sparse samples of one path end in the same state."""
    sparse, thick = model(sides), model(sides)

    at_points = sparse.run(points)
    along = thick.run(dense(points, 9))

    np.testing.assert_allclose(along[::9], at_points, atol=1e-9)
    assert thick.step(0.5) == pytest.approx(sparse.step(0.5), abs=1e-9)


@given(sides=any_sides(), history=inputs(), inside=inputs(), ends=st.tuples(UNIT, UNIT))
def test_closed_minor_loop_is_forgotten(
    sides: Sides, history: Inputs, inside: Inputs, ends: tuple[float, float]
) -> None:
    """Wiping-out: output and future are those of a model that never went through the loop."""
    low, high = sorted(ends)
    spared, disturbed = model(sides), model(sides)
    spared.run([*history, low, high])
    disturbed.run([*history, low, high])

    disturbed.run(np.clip(low + (high - low) * inside, low, high))

    assert disturbed.step(high) == pytest.approx(spared.step(high), abs=1e-11)
    assert disturbed.depth == spared.depth
    np.testing.assert_allclose(disturbed.run(history), spared.run(history), atol=1e-9)


@given(
    right=st.lists(st.floats(0.005, 0.02), min_size=19, max_size=19),
    left=st.lists(st.floats(0.005, 0.02), min_size=19, max_size=19),
    low=st.floats(0.2, 0.45),
    high=st.floats(0.55, 0.8),
)
def test_loops_between_the_same_inputs_are_not_congruent(
    right: list[float], left: list[float], low: float, high: float
) -> None:
    """The shape of a minor loop depends on whether it was reached from below or from above."""
    between = np.linspace(low, high, 9)
    mpi = MPIModel(even_thresholds(19), right, left)

    mpi.run([0.0, high, low])
    from_below = mpi.run(between)
    mpi.reset()
    mpi.run([0.0, 1.0, low])
    from_above = mpi.run(between)

    shapes = from_below - from_below[0], from_above - from_above[0]
    assert np.max(np.abs(np.subtract(*shapes))) > 1e-4


@given(sides=any_sides(), values=inputs(), repeats=st.integers(1, 4))
def test_equal_samples_change_nothing(sides: Sides, values: Inputs, repeats: int) -> None:
    """A plateau of the input gives a plateau of the output, to the bit."""
    once, repeated = model(sides).run(values), model(sides).run(np.repeat(values, repeats))

    assert repeated.tolist() == np.repeat(once, repeats).tolist()


@pytest.mark.parametrize("deadband", [0.0, 0.05])
@given(sides=any_sides(), values=inputs())
def test_input_that_is_not_a_number_is_no_move(
    deadband: float, sides: Sides, values: Inputs
) -> None:
    """NaN repeats the last output, and has no effect on later outputs."""
    with_nan = np.insert(values, np.arange(1, values.size + 1), np.nan)

    outputs = model(sides, deadband=deadband).run(with_nan)

    assert outputs[0::2].tolist() == model(sides, deadband=deadband).run(values).tolist()
    assert outputs[1::2].tolist() == outputs[0::2].tolist()


@given(sides=any_sides(), values=st.lists(st.floats(), max_size=30).map(np.array))
def test_any_input_is_clamped_to_the_range(sides: Sides, values: Inputs) -> None:
    """Any input, infinities included, counts as the nearest end of [0, 1]."""
    clean = np.clip(np.where(np.isnan(values), 0.0, values), 0.0, 1.0)
    for k in np.flatnonzero(np.isnan(values)):
        clean[k] = clean[k - 1] if k else 0.0

    assert model(sides).run(values).tolist() == model(sides).run(clean).tolist()


@given(sides=any_sides(), values=inputs())
def test_output_stays_finite_at_loops_of_a_billionth(sides: Sides, values: Inputs) -> None:
    """Ever narrower loops around any point cost no accuracy."""
    around = values[-1] + 1e-9 * 0.5 ** np.arange(30) * (-1.0) ** np.arange(30)
    path = np.clip([*values, *around], 0.0, 1.0)

    np.testing.assert_allclose(model(sides).run(path), slow_model(sides).run(path), atol=1e-11)
