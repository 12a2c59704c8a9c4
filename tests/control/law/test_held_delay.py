"""The delay behind a held voltage, at other rates."""

from math import exp

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.law.held_delay import delay_at

DELAYS_S = st.floats(1e-5, 1e-2)
PERIODS_S = st.floats(1e-4, 1e-2)


def ramp_lag_s(tau_s: float, period_s: float) -> float:
    """Return how late a ramp of steps is seen behind two lags, sample by sample, in s."""
    lacks = 0.0
    for j in range(1, 10_000):
        t = j * period_s / tau_s
        lacks += (1.0 + t) * exp(-t)
        if t > 40.0:
            break
    return lacks * period_s


@given(tau_s=st.floats(1e-4, 5e-3), held_s=st.floats(1e-4, 2e-3), period_s=PERIODS_S)
def test_delay_is_that_of_a_ramp_of_steps(tau_s: float, held_s: float, period_s: float) -> None:
    """What a record at one rate shows of two lags, a loop at another rate shows as computed."""
    recorded_s = ramp_lag_s(tau_s, held_s)

    expected = pytest.approx(ramp_lag_s(tau_s, period_s), rel=1e-6, abs=1e-9)
    assert delay_at(recorded_s, held_s, period_s) == expected


@given(delay_s=DELAYS_S, period_s=PERIODS_S)
def test_continuous_drive_has_half_a_period_more_delay(delay_s: float, period_s: float) -> None:
    """Where the stage is slow against the period; where it is fast, it has none."""
    slow_s, fast_s = 20.0 * period_s, 0.05 * period_s

    assert delay_at(slow_s, 0.0, period_s) == pytest.approx(slow_s - 0.5 * period_s, rel=1e-3)
    assert delay_at(fast_s, 0.0, period_s) == pytest.approx(0.0, abs=1e-12)
    assert delay_at(delay_s, 0.0, period_s) <= delay_s


@given(delay_s=st.floats(-1e-2, 1e-2), period_s=PERIODS_S)
def test_same_rate_changes_nothing(delay_s: float, period_s: float) -> None:
    """To the bit."""
    assert delay_at(delay_s, period_s, period_s) == delay_s


def test_delay_of_a_ringing_mode_is_a_share_of_the_period() -> None:
    """It is negative: half a cycle at any rate, if the mode is hardly damped."""
    assert delay_at(-0.5e-3, 1e-3, 1e-4) == pytest.approx(-0.5e-4)


def test_samples_that_are_told_early_stay_as_early() -> None:
    """What no ringing can make is a fixed time."""
    assert delay_at(-3.5e-3, 1e-3, 1e-4) == pytest.approx(-3.05e-3)
    assert delay_at(-2.0e-3, 0.0, 1e-3) == -2.0e-3


def test_delays_of_the_simulated_stack_agree() -> None:
    """Those that fits of records at 1 kHz and at 10 kHz have found."""
    assert delay_at(0.2810e-3, 1e-3, 1e-4) == pytest.approx(0.6918e-3, abs=1e-5)
    assert delay_at(0.6918e-3, 1e-4, 1e-3) == pytest.approx(0.2810e-3, abs=1e-5)
