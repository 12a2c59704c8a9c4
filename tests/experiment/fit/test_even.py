"""Tests of the difference between samples that are missing and time stamps that jitter."""

import numpy as np
import pytest

from piezod.experiment.fit.even import periods_between
from piezod.hysteresis.memory import FloatArray

PERIOD_S = 1e-3


@pytest.mark.parametrize("seed", range(5))
def test_jitter_is_no_missing_sample(seed: int) -> None:
    """Stamps that are late by up to almost half a period leave no gap."""
    random = np.random.default_rng(seed)
    jitter = np.clip(0.2 * random.normal(size=20_000), -0.45, 0.45)
    t_s: FloatArray = PERIOD_S * (np.arange(20_000) + jitter)

    assert np.max(np.diff(t_s)) > 1.5 * PERIOD_S
    assert np.all(periods_between(t_s) == 1)


def test_missing_samples_are_counted_where_they_are() -> None:
    """Among stamps that jitter, too."""
    random = np.random.default_rng(1)
    kept = np.setdiff1d(np.arange(5000), [700, 1200, 1201, 1202])
    t_s = PERIOD_S * (kept + 0.05 * random.normal(size=kept.size))

    periods = periods_between(t_s)

    assert np.flatnonzero(periods > 1).tolist() == [699, 1198]
    assert periods[[699, 1198]].tolist() == [2, 4]
