"""Tests of the corner filter, which smooths the reference for the first mode."""

import cmath
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.reference.motion import CornerFilter, neighbour_share

PERIOD_S = 1e-3
MODE_HZ = 734.0

mode_hz = st.floats(1.0, 1e5)
period_s = st.floats(5e-5, 0.1)


class RecordedReference:
    """A reference that records the times at which it is evaluated."""

    def __init__(self, value: Callable[[float], float]) -> None:
        self._value = value
        self.times_s: list[float] = []

    def __call__(self, t_s: float) -> float:
        """Return the value."""
        self.times_s.append(t_s)
        return self._value(t_s)


def corner(t_s: float) -> float:
    """Return a reference that rests until 10 ms and then moves at 1 µm/s."""
    return max(0.0, t_s - 0.01)


def shaped(reference: Callable[[float], float], times_s: list[float]) -> list[float]:
    """Return the filtered reference at these times."""
    corners = CornerFilter(reference, MODE_HZ, PERIOD_S)
    return [corners.value(t_s) for t_s in times_s]


def every_period(cycles: int) -> list[float]:
    """Return the times of cycles without jitter, in s."""
    return [k * PERIOD_S for k in range(cycles)]


def test_reference_without_a_mode_is_unchanged() -> None:
    """The reference stays the same to the bit, and is evaluated once, at the instant itself."""
    reference = RecordedReference(math.sin)
    corners = CornerFilter(reference, None, PERIOD_S)

    assert [corners.value(t_s) for t_s in (0.1, 0.7, 0.2)] == [*map(math.sin, (0.1, 0.7, 0.2))]
    assert reference.times_s == [0.1, 0.7, 0.2]


@given(mode_hz, period_s)
def test_share_is_bounded_and_never_inverts_the_mode(mode_hz: float, period_s: float) -> None:
    """All weights are positive, so that no value leaves the range of the reference."""
    share = neighbour_share(mode_hz, period_s)
    gain = 1.0 - 2.0 * share * (1.0 - math.cos(math.tau * mode_hz * period_s))

    assert 0.25 <= share <= 0.3
    assert -1e-12 <= gain <= 1.0


def test_gain_at_the_mode_follows_from_the_weights() -> None:
    """A reference at 734 Hz, in samples of 1 kHz, keeps a third of its amplitude."""
    angle = math.tau * MODE_HZ

    swing = shaped(lambda t_s: cmath.exp(1j * angle * t_s).real, every_period(200))

    assert max(map(abs, swing)) == pytest.approx(1.0 - 0.6 * (1.0 - math.cos(1e-3 * angle)), 1e-2)
    assert max(map(abs, swing)) < 0.35


def test_mode_at_half_the_rate_is_removed() -> None:
    """There a weight of a quarter for each neighbour is enough."""
    corners = CornerFilter(lambda t_s: math.cos(math.tau * 500.0 * t_s), 500.0, PERIOD_S)

    swing = [corners.value(t_s) for t_s in every_period(50)]

    assert swing == pytest.approx([0.0] * 50, abs=1e-9)


def test_straight_line_is_unchanged_and_not_delayed() -> None:
    """A mean with both neighbours has no phase."""
    times_s = every_period(50)

    assert shaped(lambda t_s: 3.0 - 40.0 * t_s, times_s) == pytest.approx(
        [3.0 - 40.0 * t_s for t_s in times_s], abs=1e-12
    )


def test_deviation_at_a_corner_is_weight_times_speed_change_times_period() -> None:
    """The deviation is at the corner alone; one cycle before and after it is zero."""
    off = np.subtract(shaped(corner, every_period(21)), [*map(corner, every_period(21))])

    assert off[10] == pytest.approx(0.3 * 1.0 * PERIOD_S)
    assert np.delete(off, 10) == pytest.approx(0.0, abs=1e-12)


def test_reference_is_evaluated_once_per_cycle() -> None:
    """It is evaluated one period ahead; only the first cycle evaluates all three values."""
    reference = RecordedReference(corner)

    shaped(reference, every_period(4))

    assert reference.times_s == pytest.approx([-1e-3, 0.0, 1e-3, 2e-3, 3e-3, 4e-3])


@pytest.mark.parametrize("gap", [0.0, 0.5, 0.7, 1.3, 2.0, 5.0])
def test_neighbours_are_one_period_away_after_a_gap(gap: float) -> None:
    """After skipped cycles the value is that of a filter that starts there."""
    there = 7e-3 + gap * PERIOD_S

    after = shaped(corner, [*every_period(8), there, there + PERIOD_S])[-2:]

    assert after == pytest.approx(shaped(corner, [there, there + PERIOD_S]), abs=1e-15)


@given(
    speeds=st.lists(st.floats(-10.0, 10.0), min_size=9, max_size=9),
    jitter=st.lists(st.floats(-0.1, 0.1), min_size=40, max_size=40),
)
def test_jitter_shifts_the_reference_by_speed_times_jitter(
    speeds: list[float], jitter: list[float]
) -> None:
    """Beside the rounding of corners that is the only deviation; nothing accumulates."""
    bends_s = np.linspace(0.0, 0.04, 10)
    values = np.concatenate(([0.0], np.cumsum(speeds) * bends_s[1]))
    times_s = [(k + part) * PERIOD_S for k, part in enumerate(jitter)]

    def path(t_s: float) -> float:
        return float(np.interp(t_s, bends_s, values))

    off = np.subtract(shaped(path, times_s), [*map(path, times_s)])

    assert np.abs(off).max() <= 10.0 * PERIOD_S * (0.3 * 2.0 + 4 * 0.1)
