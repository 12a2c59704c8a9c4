"""Tests of the voltage program that conditions a stage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.axes import LimitsConfig
from piezod.config.daemon import ConditioningConfig
from piezod.control.reference.programs import conditioning
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS


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


def test_conditioning_decays_around_a_rest_inside_the_range() -> None:
    """Each swing is smaller than the one before."""
    limits = LimitsConfig(drive_min_v=0.0, drive_max_v=150.0, slew_v_per_s=1e4, rest_v=75.0)
    drive = conditioning(ConditioningConfig(cycles=5, frequency_hz=2.0), limits)
    times_s = np.linspace(0.0, drive.duration_s, 1001)[:-1]
    highest_v = [max(map(drive.drive_v, swing.tolist())) for swing in times_s.reshape(5, -1)]

    assert 140.0 < highest_v[0] < 150.0
    assert np.all(np.diff(highest_v) < -10.0)


@pytest.mark.parametrize("variant", ["duhem", "coleman-hodgdon", "bouc-wen"])
def test_wide_loop_after_conditioning_comes_back_to_its_zero(variant: str) -> None:
    """At an end of the range all swings are whole, so that no later loop ends elsewhere."""
    plant = Plant(VARIANTS[variant].parameters, np.random.SeedSequence(1))
    limits = LimitsConfig(drive_min_v=0.0, drive_max_v=150.0, slew_v_per_s=1e4, rest_v=0.0)
    drive = conditioning(ConditioningConfig(), limits)
    loop_v = 75.0 - 75.0 * np.cos(2.0 * np.pi * np.arange(0.0, 2.0, 1e-3))
    rest_v = np.zeros(2000)
    swing_v = np.array([drive.drive_v(t) for t in np.arange(0.0, drive.duration_s, 1e-3)])
    drives_v = np.concatenate((swing_v, rest_v, loop_v, rest_v))
    readings_v, truths_um = np.empty((2, drives_v.size))
    plant.play(drives_v, 20, readings_v, truths_um)
    zero_um = truths_um[swing_v.size + rest_v.size - 1]

    assert abs(truths_um[-1] - zero_um) < 0.01 * np.ptp(truths_um)
