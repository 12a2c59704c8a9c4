"""Tests of the noise estimate: noise against motion, and spikes against noise."""

import math
from statistics import fmean

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.control.signals import (
    LEAST_VARIANCE,
    START_VARIANCE,
    USUAL_CYCLES,
    NoiseLevel,
)

SIGMA = 6e-4  # of the range: 18 nm on 30 µm
SEEDS = st.integers(0, 2**32 - 1)


def settled(draws: np.random.Generator, sigma: float = SIGMA) -> NoiseLevel:
    """Return an estimate that has learned this noise."""
    noise = NoiseLevel()
    for _ in range(3000):
        noise.update(0.5 + draws.normal(0.0, sigma))
    return noise


@pytest.mark.parametrize("sigma", [2e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("swing", [0.0, 1.0])
def test_variance_is_that_of_the_noise(sigma: float, swing: float) -> None:
    """The estimate is right at rest and during a full swing at 0.5 Hz, in cycles of 1 ms."""
    draws = np.random.default_rng(3)
    noise, variances = NoiseLevel(), []
    for k in range(20_000):
        motion = swing * (0.5 - 0.5 * math.cos(math.pi * 1e-3 * k))
        noise.update(motion + draws.normal(0.0, sigma))
        variances.append(noise.variance)

    assert fmean(variances[4000:]) == pytest.approx(sigma**2, rel=0.05)


@given(seed=SEEDS)
@settings(max_examples=20)
def test_noise_has_no_spikes(seed: int) -> None:
    """Constant white noise contains no spikes."""
    draws = np.random.default_rng(seed)
    noise = settled(draws)

    assert not any(noise.update(0.5 + draws.normal(0.0, SIGMA)) for _ in range(2000))


@given(seed=SEEDS, height=st.floats(0.02, 1.0), sign=st.sampled_from([-1.0, 1.0]))
@settings(max_examples=20)
def test_spike_is_detected_at_once_and_hardly_raises_the_estimate(
    seed: int, height: float, sign: float
) -> None:
    """A spike shows in three samples, and raises the variance by less than a quarter."""
    draws = np.random.default_rng(seed)
    noise = settled(draws)
    before = noise.variance

    found = [
        noise.update(0.5 + draws.normal(0.0, SIGMA) + (sign * height if k == 0 else 0.0))
        for k in range(10)
    ]

    assert found == [True] * 3 + [False] * 7
    assert noise.variance < 1.25 * before


def test_noise_ten_times_larger_is_learned_and_unlearned() -> None:
    """Its spikes end within half a second; after it the estimate returns to the first value."""
    draws = np.random.default_rng(5)
    noise = settled(draws)

    spikes = [noise.update(draws.normal(0.0, 10 * SIGMA)) for _ in range(2000)]
    loud = noise.variance
    for _ in range(2000):
        noise.update(draws.normal(0.0, SIGMA))

    assert sum(spikes[:100]) > 30
    assert not any(spikes[500:])
    assert loud == pytest.approx((10 * SIGMA) ** 2, rel=0.4)
    assert noise.variance == pytest.approx(SIGMA**2, rel=0.4)


def test_noise_is_unusual_until_it_is_usual() -> None:
    """Ten times the noise is unusual at first, and usual after three time constants."""
    draws = np.random.default_rng(7)
    noise = settled(draws)
    assert not noise.unusual

    verdicts = []
    for _ in range(3 * USUAL_CYCLES):
        noise.update(draws.normal(0.0, 10 * SIGMA))
        verdicts.append(noise.unusual)

    assert all(verdicts[500 : 2 * USUAL_CYCLES])
    assert not verdicts[-1]


def test_first_samples_are_no_spikes() -> None:
    """The first samples, at any position, leave the estimate as it is."""
    noise = NoiseLevel()

    assert [noise.update(0.9), noise.update(0.9)] == [False, False]
    assert noise.variance == START_VARIANCE


def test_variance_has_a_floor() -> None:
    """A sensor without noise may move after any rest without a spike."""
    noise = NoiseLevel()
    for _ in range(10_000):
        noise.update(0.5)

    assert noise.variance == LEAST_VARIANCE
    assert not any(noise.update(0.5 * math.cos(0.01 * k)) for k in range(1000))
