"""Drift of a stage, from what its plays have shown."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.dynamics.drift import LAST, Drift, Estimate, Trend
from piezod.dynamics.model import FloatArray

PLAY_S = 13.0
SIGMA = 1e-4


def trend_of(*values: float, sigma: float = SIGMA, waveform: int = 0) -> Trend:
    """Return what plays of one waveform have shown."""
    trend = Trend(1.0)
    for k, value in enumerate(values):
        trend.saw(PLAY_S * k, waveform, Estimate(value, sigma))
    return trend


@given(st.floats(-1e-3, 1e-3), st.lists(st.floats(0.9, 1.1), min_size=2, max_size=3))
def test_rate_is_found_across_waveforms(rate: float, levels: list[float]) -> None:
    """Each waveform has a level of its own; the rate is that of all."""
    trend, t_s = Trend(1.0), 0.0
    for waveform, level in enumerate(levels):
        for _ in range(3):
            trend.saw(t_s, waveform, Estimate(level + rate * t_s, 1e-7))
            t_s += PLAY_S
    expected = levels[-1] + rate * t_s

    if abs(rate) > 1e-7:
        assert trend.rate() == pytest.approx(rate)
    assert trend.at(t_s) == pytest.approx(expected, abs=2e-7 * PLAY_S)


def test_noise_is_no_drift() -> None:
    """Of 2000 constant stages with noise less than one in a hundred gets a rate."""
    rng = np.random.default_rng(1)
    rates = [trend_of(*(1.0 + SIGMA * rng.standard_normal(LAST))).rate() for _ in range(2000)]

    assert np.count_nonzero(rates) < 20


def test_noise_that_is_larger_than_thought_is_no_drift() -> None:
    """Values that miss the line by more than their σ make the rate as uncertain as they are."""
    rng = np.random.default_rng(2)
    values = 1.0 + 100.0 * SIGMA * rng.standard_normal((2000, LAST))
    rates = [trend_of(*each).rate() for each in values]

    assert np.count_nonzero(rates) < 100


@pytest.mark.parametrize("before", range(1, LAST))
def test_jump_is_no_drift(before: int) -> None:
    """A stage whose gain halves at once has no rate."""
    trend = trend_of(*[1.0] * before, *[2.0] * (LAST - before))

    assert trend.rate() == 0.0
    assert trend.at(PLAY_S * LAST) == (1.0 if before == LAST else 2.0)


@pytest.mark.parametrize("plays", [0, 1, 2])
def test_two_plays_show_no_drift(plays: int) -> None:
    """A line through two points has no misfit: it takes three to see that it is one."""
    trend = trend_of(*(1.0 + 0.01 * np.arange(plays)))

    assert trend.rate() == 0.0
    assert trend_of(1.0, 1.01, 1.02).rate() == pytest.approx(0.01 / PLAY_S)


def test_old_plays_no_longer_count() -> None:
    """A drift that ends leaves no rate after some further plays."""
    trend = trend_of(*(1.0 + 0.01 * np.arange(5)), *[1.04] * LAST)

    assert trend.rate() == 0.0


def test_learning_that_closes_in_is_no_drift() -> None:
    """Values that approach the last one by corrections of which a tenth is wrong have no rate."""
    trend = Trend(1.0)
    for k, correction in enumerate(0.03 * 0.3 ** np.arange(6)):
        trend.saw(PLAY_S * k, 0, Estimate(1.0 - 0.1 * correction, 0.1 * correction))

        assert trend.rate() == 0.0


N = 40
MODEL = 12.0 - 10.0 * np.cos(2.0 * np.pi * np.arange(N) / N)
NOISE = np.full(N // 2 + 1, 1e-4)


def seen(drift: Drift, t_s: float, needed: FloatArray, model: FloatArray = MODEL) -> None:
    """Show a drift the input that a play has needed."""
    drift.saw(t_s, np.fft.rfft(model), np.fft.rfft(needed), NOISE, np.zeros(NOISE.size))


def test_scale_and_offset_drift_apart() -> None:
    """A zero that drifts changes no scale; both are carried on."""
    drift = Drift()
    drift.begin(0.0, MODEL)
    for k in range(4):
        seen(drift, PLAY_S * k, 0.98 * MODEL + 0.1 * k)

    assert drift.change(1.0, 1.0 + PLAY_S) == pytest.approx(0.1)
    assert drift.begin(4.0 * PLAY_S, MODEL) == pytest.approx(0.98 * MODEL + 0.4)


def test_gain_that_grows_is_no_offset() -> None:
    """The scale has the rate, and another waveform gets all of it."""
    drift = Drift()
    drift.begin(0.0, MODEL)
    for k in range(4):
        seen(drift, PLAY_S * k, (1.0 - 0.002 * k) * MODEL)

    assert drift.change(0.0, PLAY_S) == pytest.approx(-0.002 * MODEL)
    smaller = 3.0 + 0.5 * MODEL
    assert drift.begin(4.0 * PLAY_S, smaller) == pytest.approx(0.992 * smaller)


def test_small_waveform_says_little_of_a_large_one() -> None:
    """What the model lacks is carried over in µm: about the mean of the small waveform."""
    drift = Drift()
    small = 8.0 + 0.1 * (MODEL - 12.0)
    drift.begin(0.0, small)
    seen(drift, 0.0, 7.5 + 0.11 * (MODEL - 12.0), small)

    assert drift.begin(PLAY_S, MODEL) == pytest.approx(7.5 + 1.01 * (MODEL - 8.0))


def test_unknown_stage_is_as_the_model_says() -> None:
    """Before the first play the first input is that of the model."""
    assert Drift().begin(100.0, MODEL) == pytest.approx(MODEL)
