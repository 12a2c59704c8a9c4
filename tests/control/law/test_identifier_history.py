"""Tests of the history of the voltages in force."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.law.compensator import DriveHistory

MS = 1_000_000


def ramp(cycles: int, entries: int = 256) -> DriveHistory:
    """Return the history of k volts at k milliseconds, after a rest at -1 V."""
    history = DriveHistory(-1.0, entries)
    for k in range(cycles):
        history.append(k * MS, float(k))
    return history


def test_voltage_at_an_entry_is_that_entry() -> None:
    """The voltage of a whole cycle is the stored one."""
    history = ramp(10)

    assert [history.at(k * MS) for k in range(10)] == [float(k) for k in range(10)]


@given(t_ns=st.integers(0, 9 * MS))
def test_voltage_between_entries_is_interpolated(t_ns: int) -> None:
    """A delay need not be a whole number of cycles."""
    assert ramp(10).at(t_ns) == pytest.approx(t_ns / MS, abs=1e-9)


def test_voltage_before_the_first_entry_is_that_at_rest() -> None:
    """Before the loop started, the rest voltage was in force."""
    assert ramp(10).at(-1) == -1.0
    assert ramp(1).at(-(10**12)) == -1.0


def test_voltage_after_the_newest_entry_is_the_newest() -> None:
    """The history does not extrapolate."""
    assert ramp(10).at(9 * MS + 1) == 9.0
    assert ramp(10).at(10**12) == 9.0


def test_history_without_entries_is_at_rest() -> None:
    """Before the first cycle every instant has the rest voltage."""
    assert DriveHistory(7.0, entries=8).at(0) == 7.0
    assert DriveHistory(7.0, entries=8).at(123 * MS) == 7.0


@pytest.mark.parametrize("cycles", [8, 9, 20, 1000])
def test_voltage_before_the_oldest_entry_is_the_oldest(cycles: int) -> None:
    """Fixed memory: an instant that has left the ring gets the oldest voltage."""
    history = ramp(cycles, entries=8)
    oldest = cycles - 8

    assert history.at(oldest * MS) == oldest
    assert history.at(oldest * MS - 1) == oldest
    assert history.at(-1) == oldest
    assert history.at((cycles - 1) * MS) == cycles - 1


def test_uneven_cycles_are_interpolated_by_their_times() -> None:
    """A late cycle does not shift the pairing."""
    history = DriveHistory(0.0, entries=256)
    for t_ms, drive_v in ((0, 0.0), (1, 10.0), (5, 50.0), (6, 0.0)):
        history.append(t_ms * MS, drive_v)

    assert history.at(3 * MS) == pytest.approx(30.0)
    assert history.at(5 * MS + MS // 2) == pytest.approx(25.0)
