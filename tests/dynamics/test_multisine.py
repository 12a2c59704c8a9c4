"""Multisines: whole periods, odd lines, low peaks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.dynamics.multisine import low_peak_multisine, odd_harmonics


@given(st.integers(1, 20), st.integers(40, 2000), st.integers(2, 120))
def test_lines_are_odd_and_within_the_band(low: int, high: int, count: int) -> None:
    """Lines are distinct odd harmonics, at most as many as wanted."""
    harmonics = odd_harmonics(low, high, count)

    assert np.all(harmonics % 2 == 1)
    assert np.all(np.diff(harmonics) > 0)
    assert low - 1 <= harmonics[0]
    assert harmonics[-1] <= high
    assert harmonics.size <= count


@pytest.mark.parametrize("highest", [99, 899])
def test_peak_is_low(highest: int) -> None:
    """The crest factor is below that of random phases, about 3, and the peak is true."""
    lines = low_peak_multisine(odd_harmonics(1, highest, 60))
    values = lines.sample(np.arange(100_000) / 100_000)

    assert lines.crest_factor < 2.3
    assert np.max(np.abs(values)) == pytest.approx(lines.peak, rel=0.02)


def test_it_starts_near_zero() -> None:
    """The stage does not jump when the multisine begins."""
    lines = low_peak_multisine(odd_harmonics(1, 899, 60))

    assert abs(lines.sample(np.zeros(1))[0]) < 0.05 * lines.peak


def test_whole_periods_have_no_leakage() -> None:
    """Between its lines the spectrum of a period is empty, and all lines are equally strong."""
    harmonics = odd_harmonics(1, 200, 40)
    n = 1000

    spectrum = np.fft.rfft(low_peak_multisine(harmonics).sample(np.arange(n) / n)) / (n / 2)

    assert np.abs(spectrum[harmonics]) == pytest.approx(np.ones(harmonics.size))
    assert np.max(np.abs(np.delete(spectrum, harmonics))) < 1e-9
