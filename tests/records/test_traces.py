import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from piezod.records.figures.traces import MAX_BINS, draw_trace, kept_indices


def test_short_traces_are_kept_whole() -> None:
    """Traces of up to two samples per bin are not decimated."""
    values = np.arange(200.0)

    assert np.array_equal(kept_indices(values, n_bins=100), np.arange(200))


@given(
    n_samples=st.integers(1, 3000),
    n_bins=st.integers(1, 200),
    spike=st.integers(0, 2999),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_spike_is_lost(n_samples: int, n_bins: int, spike: int, seed: int) -> None:
    """First and last sample and any single spike of any column survive, in rising order."""
    random = np.random.default_rng(seed)
    one, two = random.normal(size=(2, n_samples))
    at = spike % n_samples
    two[at] = 100.0
    one[(at * 7) % n_samples] = -100.0

    kept = kept_indices(one, two, n_bins=n_bins)

    assert {0, n_samples - 1, at, (at * 7) % n_samples} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)
    assert kept.size <= max(2 * n_bins, 4 * n_bins + 2)
    assert (one[kept].min(), one[kept].max()) == (one.min(), one.max())


def test_gaps_stay_gaps() -> None:
    """A single invalid sample among many stays visible, and hides no extreme of its bin."""
    values = np.zeros(10_000)
    values[5000] = np.nan
    values[5001] = 3.0

    kept = kept_indices(values, n_bins=100)

    assert {5000, 5001} <= set(kept.tolist())


def test_trace_without_a_valid_sample() -> None:
    """A column of NaN alone is decimated like any other."""
    assert kept_indices(np.full(1000, np.nan), n_bins=10)[[0, -1]].tolist() == [0, 999]


@pytest.mark.parametrize("n_samples", [2 * MAX_BINS, 2 * MAX_BINS + 1, 300_000])
def test_lines_stay_small(n_samples: int) -> None:
    """For any record length, a line has at most four points per bin, two for each column."""
    t_s = np.arange(n_samples) / 1000
    line = draw_trace(Figure().add_subplot(), t_s, np.sin(t_s), color="red", label="wave")

    assert np.size(line.get_xdata()) <= 4 * MAX_BINS + 2
    assert line.get_label() == "wave"
