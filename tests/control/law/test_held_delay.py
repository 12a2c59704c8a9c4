"""The delay behind a held voltage, at other rates."""

from math import exp, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.first_mode import FirstModeConfig
from piezod.control.law.held_delay import delay_at, stage_delay

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


def mode(frequency_hz: float, damping: float = 0.001) -> FirstModeConfig:
    """Return a first mode."""
    return FirstModeConfig(frequency_hz=frequency_hz, damping=damping)


def test_slow_stage_lacks_the_delay_of_its_sensor() -> None:
    """Whether its mode is known or not, if it is slow against the rate of the loop."""
    assert stage_delay(0.7e-3, 0.6e-3, 1e-4, None) == pytest.approx(0.1e-3)
    assert stage_delay(0.7e-3, 0.6e-3, 1e-4, mode(400.0)) == pytest.approx(0.1e-3, abs=2e-6)


@given(delay_s=st.floats(-2e-3, 2e-3), mode_hz=st.floats(500.0, 2000.0))
def test_stage_that_rings_is_shown_half_a_cycle_early(delay_s: float, mode_hz: float) -> None:
    """A sensor does not tell; without a delay of the sensor, the stage is as it is shown."""
    rings = pytest.approx(-0.5e-3, abs=1e-6)
    assert stage_delay(delay_s, 0.1e-3, 1e-3, mode(mode_hz)) == rings
    assert stage_delay(delay_s, 0.0, 1e-3, mode(mode_hz)) == delay_s


@pytest.mark.parametrize("damping", [0.1, 0.2, 0.5, 1.0])
def test_stage_that_has_settled_by_the_next_cycle_has_no_delay(damping: float) -> None:
    """A ring that decays is in the sum of its steps only as far as it is left."""
    left = np.exp(-2.0 * pi * 0.5 * damping * np.arange(1, 20))  # turns by half in a cycle
    expected = pytest.approx(1e-3 * np.sum(left * (-1.0) ** np.arange(1, 20)), abs=0.05e-3)

    assert stage_delay(0.3e-3, 0.6e-3, 1e-3, mode(500.0, damping)) == expected


@pytest.mark.parametrize("mode_hz", [100.0, 200.0, 300.0, 400.0])
def test_between_both_a_part_of_the_lag_remains(mode_hz: float) -> None:
    """As of a mode behind a lag of 0.1 ms, hardly damped, whose steps are summed up."""
    angle = 2.0 * pi * mode_hz * 1e-3
    steps = np.arange(1, 20_000)
    lacks = np.exp(-1e-3 * angle * steps) * np.cos(angle * (steps - 0.1))

    expected = pytest.approx(1e-3 * np.sum(lacks), abs=0.02e-3)
    assert stage_delay(0.2e-3, 0.6e-3, 1e-3, mode(mode_hz)) == expected
