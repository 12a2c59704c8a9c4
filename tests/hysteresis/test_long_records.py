"""The long versions: many operators, thousands of turning points, loops of every size."""

import numpy as np
import pytest
from numpy.typing import NDArray

from piezod.hysteresis import MPIModel
from tests.hysteresis import oracle

pytestmark = pytest.mark.stress


def random_side(
    random: np.random.Generator, least: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return 19 thresholds and weights of a side with slopes of at least `least`."""
    cells = 0.01 + 0.8 * random.dirichlet(np.ones(20))
    parts = random.exponential(size=20)
    slopes = least + (1 - least) * parts / (parts @ cells)
    thresholds = np.cumsum(cells)[:-1]
    return thresholds, (1 - thresholds) * np.diff(slopes)


def random_model(random: np.random.Generator, least: float) -> MPIModel:
    """Return a model with weights of either sign and a memory that is large enough."""
    right, q_right = random_side(random, least)
    left, q_left = random_side(random, least)
    return MPIModel(right, q_right, q_left, left_thresholds=left, capacity=64)


def turning_points(random: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return inputs whose moves have every size, from the whole range down to 1e-9."""
    points = [0.0]
    for size, to in zip(10 ** random.uniform(-9, 0.5, count), random.random(count), strict=True):
        points.append(min(max(points[-1] + size * (to - 0.5), 0.0), 1.0))
    return np.array(points)


@pytest.mark.parametrize("seed", range(40))
def test_closed_form_is_the_sum_of_the_operators_over_long_records(seed: int) -> None:
    """For 38 operators and 3000 turning points both agree to 1e-11."""
    random = np.random.default_rng(seed)
    mpi = random_model(random, 0.05)
    path = turning_points(random, 3000)
    slow = oracle.Model(
        list(mpi.right_thresholds),
        list(mpi.left_thresholds),
        list(mpi.right_weights),
        list(mpi.left_weights),
    )

    np.testing.assert_allclose(mpi.run(path), slow.run(path), rtol=0, atol=1e-11)


@pytest.mark.parametrize("seed", range(200))
def test_exact_inverse_undoes_long_records(seed: int) -> None:
    """In both orders, 20000 turning points leave no error behind."""
    random = np.random.default_rng(seed)
    mpi = random_model(random, 0.55)
    path = turning_points(random, 20_000)

    there_and_back = mpi.exact_inverse().run(mpi.run(path))
    mpi.reset()
    back_and_there = mpi.run(mpi.exact_inverse().run(path))

    np.testing.assert_allclose(there_and_back, path, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back_and_there, path, rtol=0, atol=1e-12)
