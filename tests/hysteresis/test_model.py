"""Common behaviour of the forward model and both inverses: steps, runs, states and refusals."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import ExactInverse, InverseMPI, MPIModel
from tests.hysteresis.draw import inputs

Inputs = NDArray[np.float64]
AnyModel: TypeAlias = MPIModel | InverseMPI | ExactInverse


def forward(deadband: float = 0.0, capacity: int = 32) -> MPIModel:
    """Return a model with weights of both signs and thresholds of its own on each side."""
    return MPIModel(
        [0.2, 0.5, 0.9],
        [0.1, -0.05, 0.02],
        [0.08, 0.1],
        left_thresholds=[0.3, 0.6],
        deadband=deadband,
        capacity=capacity,
    )


def analytic() -> InverseMPI:
    """Return the analytic inverse of that model."""
    return forward().inverse()


def exact() -> ExactInverse:
    """Return the exact inverse of that model."""
    return forward().exact_inverse()


def behind_a_deadband() -> MPIModel:
    """Return that model with a dead-band."""
    return forward(deadband=0.01)


def of_small_capacity() -> MPIModel:
    """Return that model with a memory that is soon full."""
    return forward(capacity=4)


MAKERS: list[Callable[[], AnyModel]] = [
    forward,
    analytic,
    exact,
    behind_a_deadband,
    of_small_capacity,
]
every_model = pytest.mark.parametrize("make", MAKERS)
few = settings(max_examples=25)  # of each model


@every_model
@few
@given(values=inputs())
def test_steps_are_a_run_to_the_bit(make: Callable[[], AnyModel], values: Inputs) -> None:
    """Steps sample by sample and a run over the array give the same numbers."""
    one = make()

    assert [one.step(float(v)) for v in values] == make().run(values).tolist()


@every_model
@few
@given(values=inputs(), cut=st.integers(0, 40))
def test_run_continues_from_the_state(
    make: Callable[[], AnyModel], values: Inputs, cut: int
) -> None:
    """A record cut in two gives the same outputs to the bit."""
    one = make()

    parts = [*one.run(values[:cut]), *one.run(values[cut:])]

    assert parts == make().run(values).tolist()


@every_model
@few
@given(past=inputs(), other=inputs(), future=inputs())
def test_restored_state_continues_as_before(
    make: Callable[[], AnyModel], past: Inputs, other: Inputs, future: Inputs
) -> None:
    """A saved state does not change with later steps of the model."""
    one = make()
    one.run(past)
    saved = one.state()
    expected = one.run(future).tolist()
    one.run(other)

    one.restore(saved)
    assert one.run(future).tolist() == expected
    one.restore(saved)
    assert one.run(future).tolist() == expected


@every_model
@few
@given(past=inputs(), other=inputs(), future=inputs())
def test_copy_is_independent(
    make: Callable[[], AnyModel], past: Inputs, other: Inputs, future: Inputs
) -> None:
    """A copy continues from the same state, and neither disturbs the other."""
    one = make()
    one.run(past)
    twin = one.copy()
    one.run(other)
    of_twin = twin.run(future).tolist()

    again = make()
    again.run(past)
    assert of_twin == again.run(future).tolist()
    again.reset()
    again.run(past)
    again.run(other)
    assert one.run(future).tolist() == again.run(future).tolist()


@every_model
@few
@given(past=inputs(), future=inputs())
def test_reset_model_is_a_new_one(
    make: Callable[[], AnyModel], past: Inputs, future: Inputs
) -> None:
    """After `reset` nothing of the past remains, counters included."""
    one = make()
    one.run(past)

    one.reset()

    assert (one.depth, one.merged_pairs) == (0, 0)
    assert one.run(future).tolist() == make().run(future).tolist()


@pytest.mark.parametrize("make", [forward, analytic, exact, of_small_capacity])
def test_ends_of_the_range_are_kept(make: Callable[[], AnyModel]) -> None:
    """From rest, 0 gives 0 and 1 gives 1."""
    one = make()

    assert one.step(0.0) == 0.0
    assert one.step(1.0) == pytest.approx(1.0, abs=1e-12)


def test_start_above_zero_is_a_step_from_zero() -> None:
    """A first input of 0.35 leaves the same state as 0 followed by 0.35."""
    path = [0.35, 0.2, 0.6, 0.5, 0.9]

    assert forward().run(path).tolist() == forward().run([0.0, *path])[1:].tolist()


def test_run_takes_any_sequence_of_numbers() -> None:
    """Lists, integers and strided arrays are accepted."""
    values = np.linspace(0, 1, 9)
    expected = forward().run(values[::2]).tolist()

    assert forward().run(values[::2].tolist()).tolist() == expected
    assert forward().run([0, 1]).tolist() == forward().run([0.0, 1.0]).tolist()
    assert forward().run([]).tolist() == []


@pytest.mark.parametrize(
    "thresholds", [[], [0.0, 0.5], [0.5, 1.0], [0.5, 0.5], [0.6, 0.5], [0.5, np.nan], [[0.5]]]
)
def test_thresholds_that_do_not_increase_inside_the_range_are_refused(
    thresholds: list[float],
) -> None:
    """The message states the rule and the given values, for either side of either model."""
    message = r"thresholds must increase strictly inside \(0, 1\), got \["
    weights = np.zeros(np.shape(thresholds))
    with pytest.raises(ModelError, match=message):
        MPIModel(thresholds, weights, weights)
    with pytest.raises(ModelError, match=message):
        MPIModel([0.5], [0.1], weights, left_thresholds=thresholds)
    with pytest.raises(ModelError, match=message):
        InverseMPI(thresholds, [0.5], weights, [0.1])


@pytest.mark.parametrize("weights", [[], [0.1], [0.1, 0.1, 0.1], [0.1, np.inf], [np.nan, 0.1]])
def test_weights_that_do_not_fit_the_thresholds_are_refused(weights: list[float]) -> None:
    """The message states the required number of weights."""
    message = "need 2 finite weights, one per threshold, got"
    with pytest.raises(ModelError, match=message):
        MPIModel([0.3, 0.6], weights, [0.1, 0.1])
    with pytest.raises(ModelError, match=message):
        MPIModel([0.3, 0.6], [0.1, 0.1], weights)
    with pytest.raises(ModelError, match=message):
        InverseMPI([0.3, 0.6], [0.3, 0.6], [0.1, 0.1], weights)


def test_capacity_too_small_to_merge_is_refused() -> None:
    """The message states the smallest capacity."""
    with pytest.raises(ModelError, match="capacity of at least 4 extrema on each side, got 3"):
        forward(capacity=3)


def test_state_of_another_capacity_is_refused() -> None:
    """A state of a larger memory is refused and not truncated."""
    with pytest.raises(ModelError, match="model of another kind or capacity"):
        forward(capacity=8).restore(forward(capacity=16).state())
