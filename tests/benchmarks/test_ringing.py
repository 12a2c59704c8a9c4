"""Tests of the drives of the records that ring."""

import numpy as np
import pytest

from benchmarks.peers.simulated import FULL_V
from benchmarks.ringing import HELD_S, RATE_HZ, SLOW_S, drive


@pytest.mark.parametrize("held_s", HELD_S.values())
def test_random_voltages_are_held(held_s: tuple[float, float]) -> None:
    """After a slow start each voltage is held for as long as its drive says; seeds differ."""
    first, again, other = (drive(held_s, seed) for seed in (1, 1, 2))
    start = round(SLOW_S * RATE_HZ)
    jumps = np.flatnonzero(np.diff(first[start:]))

    assert np.array_equal(first, again)
    assert np.array_equal(first[:start], other[:start])
    assert not np.array_equal(first, other)
    assert first.min() == 0.0
    assert first.max() <= FULL_V
    assert np.diff(jumps).min() >= held_s[0] * RATE_HZ - 1
    assert np.diff(jumps).max() <= held_s[1] * RATE_HZ + 1
