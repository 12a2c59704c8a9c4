"""The delay from drive to displacement, estimated from records."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.errors import DataError
from piezod.experiment.fit.delay import DelayEstimate, estimate_delay, longest_delay_periods
from piezod.experiment.fit.record import Record
from piezod.hysteresis import AffineRange, even_thresholds, new_bank, stop_regressors
from piezod.records.csv_file import read_csv
from tests.experiment.made_up import FINER, ORDER, RATE_HZ, record_of, sine


def estimate(record: Record, order: int = ORDER) -> DelayEstimate:
    """Estimate the delay of a record over its own ranges."""
    bank = new_bank(even_thresholds(order), even_thresholds(order))
    low_um, high_um = float(record.position_um.min()), float(record.position_um.max())
    x = AffineRange.checked(low_um, high_um).to_unit(record.position_um)
    drive_v = AffineRange.checked(float(record.drive_v.min()), float(record.drive_v.max()))
    return estimate_delay(record, stop_regressors(bank, x), x, drive_v)


@settings(max_examples=10)
@given(steps=st.integers(0, round(5.9 * FINER)))
def test_parts_of_a_sample_are_found(steps: int) -> None:
    """A record of loops of many sizes tells the delay to a tenth of a sample."""
    delay_periods = steps / FINER

    found = estimate(record_of(delay_periods=delay_periods))

    assert abs(found.delay_s * RATE_HZ - delay_periods) < 0.1
    assert not found.one_frequency


def test_noise_moves_the_estimate_by_less_than_a_tenth_of_a_sample() -> None:
    """The sensor's noise of 0.1 % of the range does little harm."""
    record = record_of(delay_periods=2.34)
    noise_um = 0.03 * np.random.default_rng(1).normal(size=record.t_s.size)

    found = estimate(Record(record.t_s, record.drive_v, record.position_um + noise_um))

    assert abs(found.delay_s * RATE_HZ - 2.34) < 0.1


def test_one_frequency_is_said_and_leaves_a_sample_of_doubt() -> None:
    """A sine looks alike with a longer delay and a narrower loop."""
    found = estimate(record_of(delay_periods=1.5, path=sine), order=19)

    assert found.one_frequency
    assert found.uncertainty_s >= 1.0 / RATE_HZ
    assert abs(found.delay_s * RATE_HZ - 1.5) < 1.0


def test_criterion_is_the_error_at_each_candidate() -> None:
    """The curve goes from no delay to the longest, and is least at the estimate."""
    found = estimate(record_of(delay_periods=3.0))

    assert found.candidates_s[0] == 0.0
    assert found.candidates_s[-1] == pytest.approx(longest_delay_periods(1 / RATE_HZ) / RATE_HZ)
    assert found.criterion_pct.shape == found.candidates_s.shape
    best_s = found.candidates_s[np.argmin(found.criterion_pct)]
    assert best_s == pytest.approx(found.delay_s, abs=0.05 / RATE_HZ)
    assert found.uncertainty_s >= 0.05 / RATE_HZ


def test_longer_delays_end_at_the_longest_candidate() -> None:
    """What lies outside of the search cannot be found, and is not extrapolated."""
    found = estimate(record_of(delay_periods=8.0))

    assert found.delay_s == found.candidates_s[-1]


@pytest.mark.parametrize(
    ("period_s", "periods"), [(5e-3, 6), (1e-3, 20), (5e-4, 40), (1e-4, 60), (1e-5, 60)]
)
def test_the_search_goes_back_by_20_ms_or_what_can_be_afforded(
    period_s: float, periods: int
) -> None:
    """It is 6 periods of a slow record and 60 of a fast one."""
    assert longest_delay_periods(period_s) == periods


def test_a_shift_could_hide_in_what_the_fit_leaves() -> None:
    """With five times the noise the delay is at least half as much less certain."""
    record = record_of(delay_periods=2.0)
    noise_um = np.random.default_rng(1).normal(size=record.t_s.size)
    quiet, loud = (
        estimate(Record(record.t_s, record.drive_v, record.position_um + rms_um * noise_um))
        for rms_um in (0.04, 0.2)
    )

    assert loud.uncertainty_s > 2.0 * quiet.uncertainty_s
    assert abs(loud.delay_s - 2.0 / RATE_HZ) < loud.uncertainty_s


def test_short_record_is_refused() -> None:
    """A handful of samples tells nothing about the delay."""
    record = record_of(duration_s=0.5)

    with pytest.raises(DataError, match="50 samples are too few to estimate a delay from"):
        estimate(record)


def test_measured_stage_lags_by_about_two_samples(shared_data: Path) -> None:
    """The recorded flexure stage was sampled every 5 ms, one sample late and at one frequency."""
    columns = read_csv(shared_data / "data" / "ntu_p885" / "identification.csv")

    record = Record(columns["t_s"], columns["drive_v"], columns["position_um"], run_in_s=1.0)
    found = estimate(record, order=19)

    assert 0.005 < found.delay_s < 0.011
    assert found.one_frequency
    assert found.uncertainty_s == pytest.approx(0.005)
