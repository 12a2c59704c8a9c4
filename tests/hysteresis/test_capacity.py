"""A full memory: it removes pairs of extrema, the error is small, and the pairs are counted."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from piezod.hysteresis import LMSIdentifier, MPIModel, even_thresholds, new_bank
from piezod.hysteresis.memory import MAXIMUM, MINIMUM
from tests.hysteresis.draw import Sides, any_sides, inputs, model

Inputs = NDArray[np.floating]
ENOUGH = 400

# Errors measured over geometric, linear and uneven decays, in units of the range. Operators on the
# same memory give the same values within a third.
#
#   capacity        4       8        16       32
#   worst      2.4e-2   3.9e-3   7.4e-4   2.5e-4
#   typical    1.0e-2   1.7e-3   2.1e-4   1.4e-5
BOUNDS = {4: 4e-2, 8: 8e-3, 16: 1.5e-3, 32: 5e-4}


def stage(capacity: int) -> MPIModel:
    """Return a model with loops of 13 % and the 19 thresholds of the paper."""
    weights = 0.043 * np.exp(-0.12 * np.arange(19))
    return MPIModel(even_thresholds(19), weights, 0.6 * weights, capacity=capacity)


def swings(amplitudes: Inputs) -> Inputs:
    """Return turning points about the middle of the range."""
    return 0.5 + 0.5 * amplitudes * (-1.0) ** np.arange(amplitudes.size)


def decays() -> list[Inputs]:
    """Return decaying inputs: geometric, linear, and with random ratios."""
    random = np.random.default_rng(1)
    geometric = [swings(ratio ** np.arange(80)) for ratio in np.arange(0.7, 0.99, 0.02)]
    linear = [swings(np.linspace(1, 0, count)) for count in range(20, 120, 20)]
    uneven = [swings(np.sort(random.random(80))[::-1]) for _ in range(20)]
    return geometric + linear + uneven


def and_back(decay: Inputs) -> list[Inputs]:
    """Return a decay followed by a move to either end, and by the same decay backwards."""
    middle = decay[-1]
    up, down = np.linspace(middle, 1, 100), np.linspace(middle, 0, 100)
    return [np.concatenate((decay, tail)) for tail in (up, down, decay[::-1])]


def operators(capacity: int) -> Callable[[Inputs], Inputs]:
    """Return a function from inputs to the sum of the operators of that model."""
    mpi = stage(capacity)
    bank = new_bank(mpi.right_thresholds, mpi.left_thresholds)
    lms = LMSIdentifier(bank, gain=0.0, capacity=capacity)
    lms.weights[:] = -np.concatenate((mpi.right_weights, mpi.left_weights)) / bank[1]
    return lambda values: -lms.run(values, np.zeros_like(values))


def worst(run: Callable[[int], Callable[[Inputs], Inputs]], capacity: int) -> Iterable[float]:
    """Yield the worst error of a memory of this capacity, for each decaying input."""
    for decay in decays():
        for path in and_back(decay):
            yield float(np.max(np.abs(run(capacity)(path) - run(ENOUGH)(path))))


@pytest.mark.parametrize(
    ("kind", "capacity"),
    [
        *(("closed form", capacity) for capacity in BOUNDS),
        ("operators", 8),
        *(
            pytest.param("operators", size, marks=pytest.mark.stress)
            for size in BOUNDS
            if size != 8
        ),
    ],
)
def test_error_of_a_full_memory_is_small_on_decaying_inputs(
    kind: str, capacity: int, record_property: Callable[[str, object], None]
) -> None:
    """The error is about 1e-3 of the range at a capacity of 8 and 1e-4 at 16."""
    run = operators if kind == "operators" else lambda size: stage(size).run

    errors = list(worst(run, capacity))

    record_property("worst", max(errors))
    record_property("typical", float(np.median(errors)))
    assert 0 < max(errors) < BOUNDS[capacity]


@pytest.mark.parametrize("decay", decays()[::7])
def test_every_removed_pair_is_counted(decay: Inputs) -> None:
    """A full memory holds fewer extrema than a large one, by twice the count of removed pairs."""
    full, enough = stage(8), stage(ENOUGH)

    full.run(decay)
    enough.run(decay)

    assert full.merged_pairs > 0
    assert enough.merged_pairs == 0
    assert enough.depth - full.depth == 2 * full.merged_pairs


def test_error_of_a_full_memory_is_forgotten_with_its_loops() -> None:
    """After the input has been at both ends, a model that removed pairs is exact again."""
    full, enough = stage(4), stage(ENOUGH)
    for model_ in (full, enough):
        model_.run([*swings(0.9 ** np.arange(80)), 1.0, 0.0])
    path = np.array([0.7, 0.2, 0.5, 0.4, 1.0])

    np.testing.assert_allclose(full.run(path), enough.run(path), rtol=0, atol=1e-12)


@given(sides=any_sides(), values=inputs(least=10, most=60))
def test_extrema_stay_nested_when_the_memory_is_full(sides: Sides, values: Inputs) -> None:
    """Maxima fall and minima rise from the outside in, and the input is inside the last loop."""
    full = model(sides, capacity=4)
    for value in values:
        x = full.step(value)
        levels, _, _, _, counts = full.state()
        maxima = levels[MAXIMUM, : counts[MAXIMUM]]
        minima = levels[MINIMUM, : counts[MINIMUM]]

        assert np.all(np.diff(maxima[1:]) < 0)
        assert np.all(np.diff(minima[1:]) > 0)
        assert minima[-1] <= value <= maxima[-1]
        assert np.isfinite(x)


def test_random_inputs_do_not_fill_the_memory() -> None:
    """For random inputs the depth grows only with the logarithm of their number."""
    random = stage(32)

    random.run(np.random.default_rng(3).random(200_000))

    assert random.merged_pairs == 0
