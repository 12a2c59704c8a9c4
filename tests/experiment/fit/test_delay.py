"""Tests of the estimate of the delay from records."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.errors import DataError
from piezod.experiment.fit.delay import DelayEstimate, estimate_delay, longest_delay_periods
from piezod.experiment.fit.record import Record
from piezod.hysteresis import AffineRange, even_thresholds, new_bank, stop_regressors
from piezod.reading.record import read_record
from tests.experiment.made_up import FINER, ORDER, RATE_HZ, record_of, sine


def estimate(record: Record, order: int = ORDER) -> DelayEstimate:
    """Return the estimate of the delay of a record, with its own ranges."""
    bank = new_bank(even_thresholds(order), even_thresholds(order))
    low_um, high_um = float(record.position_um.min()), float(record.position_um.max())
    x = AffineRange.checked(low_um, high_um).to_unit(record.position_um)
    drive_v = AffineRange.checked(float(record.drive_v.min()), float(record.drive_v.max()))
    return estimate_delay(record, stop_regressors(bank, x), x, drive_v)


@settings(max_examples=10)
@given(steps=st.integers(0, round(5.9 * FINER)))
def test_fractions_of_a_sample_are_found(steps: int) -> None:
    """Loops of many sizes determine the delay to a tenth of a sample."""
    delay_periods = steps / FINER

    found = estimate(record_of(delay_periods=delay_periods))

    assert abs(found.delay_s * RATE_HZ - delay_periods) < 0.1
    assert not found.one_frequency


def test_noise_moves_the_estimate_by_less_than_a_tenth_of_a_sample() -> None:
    """The noise is 0.1 % of the range."""
    record = record_of(delay_periods=2.34)
    noise_um = 0.03 * np.random.default_rng(1).normal(size=record.t_s.size)

    found = estimate(Record(record.t_s, record.drive_v, record.position_um + noise_um))

    assert abs(found.delay_s * RATE_HZ - 2.34) < 0.1


def test_one_frequency_is_reported_with_an_uncertainty_of_a_sample() -> None:
    """A sine looks the same with a longer delay and a narrower loop."""
    found = estimate(record_of(delay_periods=1.5, path=sine), order=19)

    assert found.one_frequency
    assert found.uncertainty_s >= 1.0 / RATE_HZ
    assert abs(found.delay_s * RATE_HZ - 1.5) < 1.0


def test_criterion_is_the_error_at_each_candidate() -> None:
    """The curve goes from no delay to the longest, and is smallest at the estimate."""
    found = estimate(record_of(delay_periods=3.0))

    assert found.candidates_s[0] == 0.0
    assert found.candidates_s[-1] == pytest.approx(longest_delay_periods(1 / RATE_HZ) / RATE_HZ)
    assert found.criterion_pct.shape == found.candidates_s.shape
    best_s = found.candidates_s[np.argmin(found.criterion_pct)]
    assert best_s == pytest.approx(found.delay_s, abs=0.05 / RATE_HZ)
    assert found.uncertainty_s >= 0.05 / RATE_HZ


def test_longer_delays_end_at_the_longest_candidate() -> None:
    """A delay outside the search is not extrapolated."""
    found = estimate(record_of(delay_periods=8.0))

    assert found.delay_s == found.candidates_s[-1]


@pytest.mark.parametrize(
    ("period_s", "periods"), [(5e-3, 6), (1e-3, 20), (5e-4, 40), (1e-4, 60), (1e-5, 60)]
)
def test_search_covers_20_ms_within_6_to_60_periods(period_s: float, periods: int) -> None:
    """A slow record has 6 periods, a fast one 60."""
    assert longest_delay_periods(period_s) == periods


def test_uncertainty_grows_with_the_error_of_the_fit() -> None:
    """With five times the noise the uncertainty grows by at least a half."""
    record = record_of(delay_periods=2.0)
    noise_um = np.random.default_rng(1).normal(size=record.t_s.size)
    quiet, loud = (
        estimate(Record(record.t_s, record.drive_v, record.position_um + rms_um * noise_um))
        for rms_um in (0.04, 0.2)
    )

    assert loud.uncertainty_s > 2.0 * quiet.uncertainty_s
    assert abs(loud.delay_s - 2.0 / RATE_HZ) < loud.uncertainty_s


def test_short_record_is_refused() -> None:
    """A few samples do not determine the delay."""
    record = record_of(duration_s=0.5)

    with pytest.raises(DataError, match="50 samples are too few to estimate a delay"):
        estimate(record)


def test_measured_stage_lags_by_about_two_samples(shared_data: Path) -> None:
    """The flexure stage was sampled every 5 ms, one sample late and at one frequency."""
    columns = read_record(shared_data / "data" / "ntu_p885" / "identification.csv").columns

    record = Record(columns["t_s"], columns["drive_v"], columns["position_um"], run_in_s=1.0)
    found = estimate(record, order=19)

    assert 0.005 < found.delay_s < 0.011
    assert found.one_frequency
    assert found.uncertainty_s == pytest.approx(0.005)
