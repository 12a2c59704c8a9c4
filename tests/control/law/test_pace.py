"""Tests of the pace of learning: what is learned must not ring the first mode."""

from math import cos, exp, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from piezod.config.first_mode import FirstModeConfig
from piezod.control.law.pace import (
    FOLLOWED_SHARE,
    RLS_SHARE,
    learning_pace,
    slowest_unknown_mode_hz,
)


def largest_pole(
    period_s: float, mode: FirstModeConfig, learned_share: float, pace: float
) -> float:
    """Return the size of the largest pole of a linear stage with its mode, and a learned offset.

    The states are two of the mode, under a drive that is held for a period, the learned offset, and
    the offset in use.
    """
    omega, damping = 2 * pi * mode.frequency_hz, mode.damping
    decay, turns = exp(-damping * omega * period_s), omega * sqrt(1 - damping**2)
    c, s = cos(turns * period_s), sin(turns * period_s)
    lead = damping * omega / turns
    free = decay * np.array([[c + lead * s, s / turns], [-(omega**2) / turns * s, c - lead * s]])
    held = (np.eye(2) - free) @ np.array([1.0, 0.0])
    learn, follow = pace * learned_share, pace * FOLLOWED_SHARE
    step = np.zeros((4, 4))
    step[:2, :2] = free
    step[:2, 3] = -held  # the drive is the command minus the offset in use
    step[2] = [learn, 0.0, 1 - learn, learn]  # of position minus drive
    step[3] = [0.0, 0.0, follow, 1 - follow]
    return float(np.max(np.abs(np.linalg.eigvals(step))))


@given(
    rate_hz=st.floats(1000, 20_000),
    frequency_hz=st.floats(30, 3000),
    damping=st.floats(0.001, 0.3),
    share=st.sampled_from([RLS_SHARE, 0.5, 1.18]),
)
@example(rate_hz=1000.0, frequency_hz=183.0, damping=0.25, share=1.18)  # a damped mode
def test_learning_never_makes_a_mode_oscillate(
    rate_hz: float, frequency_hz: float, damping: float, share: float
) -> None:
    """The loop is stable for fast and slow modes, even if the identifier learns half more."""
    mode = FirstModeConfig(frequency_hz=frequency_hz, damping=damping)
    pace = learning_pace(1.0 / rate_hz, mode, share)

    assert 0.0 < pace <= 1.0
    if frequency_hz < rate_hz / 2:  # beyond, the mode is hardly sampled, and the filters differ
        assert largest_pole(1.0 / rate_hz, mode, 1.5 * share, pace) < 1.0


@given(
    rate_hz=st.floats(2000, 20_000),
    cycles=st.floats(40, 200),
    damping=st.floats(0.005, 0.05),
    share=st.sampled_from([RLS_SHARE, 0.5, 1.18]),
)
def test_pace_of_a_sharp_mode_is_close_to_the_edge(
    rate_hz: float, cycles: float, damping: float, share: float
) -> None:
    """Where the mode limits the pace, the loop oscillates if it learns 3.2 times as fast."""
    mode = FirstModeConfig(frequency_hz=rate_hz / cycles, damping=damping)
    period_s = 1.0 / rate_hz
    pace = learning_pace(period_s, mode, share)
    assume(pace < learning_pace(period_s, None, share))

    assert largest_pole(period_s, mode, share, 3.2 * pace) > 1.0


def test_full_pace_would_make_a_sharp_mode_oscillate() -> None:
    """This is what the pace prevents."""
    mode = FirstModeConfig(frequency_hz=700.0, damping=0.015)

    assert largest_pole(1e-4, mode, RLS_SHARE, 1.0) > 1.0


def test_learning_of_the_usual_rig_is_not_slowed_down() -> None:
    """Its first mode is sharp but fast, and its loop is no faster than the constants are for."""
    assert learning_pace(1e-3, FirstModeConfig(frequency_hz=734.0, damping=0.03), RLS_SHARE) == 1.0
    assert learning_pace(1e-2, None, RLS_SHARE) == 1.0


@pytest.mark.parametrize("share", [RLS_SHARE, 0.0])
def test_more_frequent_samples_do_not_make_learning_faster(share: float) -> None:
    """A loop of 10 kHz changes the model as fast as one of 1 kHz, with a mode or without."""
    fast = FirstModeConfig(frequency_hz=3000.0, damping=0.3)

    assert learning_pace(1e-4, None, share) == pytest.approx(0.1)
    assert learning_pace(1e-4, fast, share) == pytest.approx(0.1)


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0, 2000.0, 20_000.0])
def test_only_a_slow_mode_that_nobody_knows_can_oscillate(rate_hz: float) -> None:
    """Above the limit the full pace leaves a gain margin of two, and far below it has none."""
    period_s, damping = 1.0 / rate_hz, 0.01
    limit_hz = slowest_unknown_mode_hz(period_s, damping, RLS_SHARE)
    pace = learning_pace(period_s, None, RLS_SHARE)

    def pole(frequency_hz: float, learned_share: float) -> float:
        mode = FirstModeConfig(frequency_hz=frequency_hz, damping=damping)
        return largest_pole(period_s, mode, learned_share, pace)

    above_hz = np.linspace(limit_hz, max(0.49 * rate_hz, limit_hz), 50)
    assert all(pole(each_hz, 2.0 * RLS_SHARE) < 1.0 for each_hz in above_hz)
    assert pole(0.2 * limit_hz, RLS_SHARE) > 1.0
