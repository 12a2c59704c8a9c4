"""Tests of the voltage program that conditions a stage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.axes import LimitsConfig
from piezod.config.daemon import ConditioningConfig
from piezod.control.reference.programs import conditioning


@given(low_v=st.floats(-100.0, 0.0), rest=st.floats(0.0, 1.0), cycles=st.integers(2, 20))
def test_conditioning_starts_and_ends_at_rest_inside_the_range(
    low_v: float, rest: float, cycles: int
) -> None:
    """Conditioning starts and ends at any rest voltage, and stays in the range."""
    rest_v = min(low_v + rest * (100.0 - low_v), 100.0)  # the sum may be off by rounding
    limits = LimitsConfig(drive_min_v=low_v, drive_max_v=100.0, slew_v_per_s=1e4, rest_v=rest_v)
    drive = conditioning(ConditioningConfig(cycles=cycles), limits)
    swing_v = np.array([drive.drive_v(t) for t in np.linspace(0.0, drive.duration_s, 2000)])

    assert drive.drive_v(0.0) == pytest.approx(rest_v, abs=1e-9)
    assert drive.drive_v(drive.duration_s) == rest_v
    assert np.all((swing_v >= low_v - 1e-9) & (swing_v <= 100.0 + 1e-9))


def test_conditioning_decays_from_the_whole_range() -> None:
    """The first swing has nearly the whole range, and each further one is smaller."""
    limits = LimitsConfig(drive_min_v=0.0, drive_max_v=150.0, slew_v_per_s=1e4, rest_v=0.0)
    drive = conditioning(ConditioningConfig(cycles=5, frequency_hz=2.0), limits)
    peaks_v = [drive.drive_v((k + 0.5) / 2.0) for k in range(5)]

    assert peaks_v == pytest.approx([135.0, 105.0, 75.0, 45.0, 15.0])
