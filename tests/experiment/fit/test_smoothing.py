"""Tests of the smoothing of recorded displacements."""

import numpy as np
import pytest

from piezod.experiment.fit.record import Record
from piezod.experiment.fit.smoothing import WINDOWS, longest_window, smoothed, smoothed_record

T_S = np.arange(2000) / 1000.0


@pytest.mark.parametrize("window", [5, 7, 9])
def test_parabola_is_unchanged(window: int) -> None:
    """Position, speed and acceleration stay, and nothing is delayed."""
    values = 1.0 + 2.0 * T_S - 3.0 * T_S**2

    inside = slice(window, -window)
    assert smoothed(values, window)[inside] == pytest.approx(values[inside], abs=1e-12)


def test_white_noise_is_reduced_as_in_theory() -> None:
    """The middle weight of the parabola is the remaining share of the noise power."""
    noise = np.random.default_rng(1).standard_normal(20_000)

    assert np.var(smoothed(noise, 5)) == pytest.approx(17 / 35, rel=0.05)


def test_slower_drive_allows_a_longer_window() -> None:
    """A drive that hardly bends between neighbours allows the most smoothing."""
    fast, slow = (longest_window(75.0 - 75.0 * np.cos(2 * np.pi * hz * T_S)) for hz in (20.0, 1.0))

    assert 5 <= fast < slow <= WINDOWS[0]


@pytest.mark.parametrize("end_v", [10.0, -10.0])
def test_step_is_not_rounded(end_v: float) -> None:
    """Around a jump of the drive the displacement stays as recorded."""
    step = np.where(T_S < 1.0, 0.0, end_v)
    noise = 0.01 * np.random.default_rng(1).standard_normal(T_S.size)

    seen = smoothed_record(Record(T_S, step, step + noise)).position_um

    assert np.array_equal(seen[990:1010], (step + noise)[990:1010])
    assert np.std(seen[100:900]) < 0.5 * np.std(noise)


def test_window_of_one_changes_nothing() -> None:
    """The same array is returned."""
    assert smoothed(T_S, 1) is T_S


def test_drive_of_a_record_is_not_smoothed() -> None:
    """Only the sensor has noise."""
    drive_v = np.sin(40.0 * T_S)
    record = smoothed_record(Record(T_S, drive_v, drive_v + 0.01 * np.sin(3e3 * T_S)))

    assert record.drive_v is drive_v
    assert not np.array_equal(record.position_um, drive_v)


def test_short_record_is_smoothed() -> None:
    """The window is no longer than the record."""
    drive_v = np.sin(5.0 * T_S[:120])

    assert smoothed_record(Record(T_S[:120], drive_v, drive_v.copy())).position_um.shape == (120,)
