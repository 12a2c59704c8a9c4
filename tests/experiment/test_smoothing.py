"""Smoothing of recorded displacements."""

import numpy as np
import pytest

from piezod.experiment.record import Record
from piezod.experiment.smoothing import LONGEST, longest_window, smoothed, smoothed_record

T_S = np.arange(2000) / 1000.0


@pytest.mark.parametrize("window", [5, 7, 9])
def test_a_parabola_stays_as_it_is(window: int) -> None:
    """Position, speed and acceleration are not touched, and nothing is delayed."""
    values = 1.0 + 2.0 * T_S - 3.0 * T_S**2

    inside = slice(window, -window)
    assert smoothed(values, window)[inside] == pytest.approx(values[inside], abs=1e-12)


def test_white_noise_is_taken_down_as_the_theory_says() -> None:
    """The middle weight of the parabola is the share of the noise's power that is left."""
    noise = np.random.default_rng(1).standard_normal(20_000)

    assert np.var(smoothed(noise, 5)) == pytest.approx(17 / 35, rel=0.05)


def test_a_slow_drive_bears_the_longest_window() -> None:
    """Where the drive hardly bends between neighbours, all noise that can go may go."""
    assert longest_window(75.0 - 75.0 * np.cos(2 * np.pi * T_S)) == LONGEST


def test_a_step_bears_no_smoothing() -> None:
    """A step would be rounded."""
    assert longest_window(np.where(T_S < 1.0, 0.0, 10.0)) == 1


def test_a_window_of_one_changes_nothing() -> None:
    """The same array comes back."""
    assert smoothed(T_S, 1) is T_S


def test_the_drive_of_a_record_is_not_smoothed() -> None:
    """Only the sensor has noise."""
    drive_v = np.sin(40.0 * T_S)
    record = smoothed_record(Record(T_S, drive_v, drive_v.copy()), 9)

    assert record.drive_v is drive_v
    assert not np.array_equal(record.position_um, drive_v)
