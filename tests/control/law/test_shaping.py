"""Shaping of the reference for the first mode."""

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


class Asked:
    """A reference that writes down when it was asked for."""

    def __init__(self, value: Callable[[float], float]) -> None:
        self._value = value
        self.times_s: list[float] = []

    def __call__(self, t_s: float) -> float:
        """Give the value."""
        self.times_s.append(t_s)
        return self._value(t_s)


def corner(t_s: float) -> float:
    """Return a reference that stands until 10 ms and then moves with 1 µm/s."""
    return max(0.0, t_s - 0.01)


def shaped(reference: Callable[[float], float], times_s: list[float]) -> list[float]:
    """Return the shaped reference at these times."""
    corners = CornerFilter(reference, MODE_HZ, PERIOD_S)
    return [corners.value(t_s) for t_s in times_s]


def every_period(cycles: int) -> list[float]:
    """Return the times of cycles without jitter, in s."""
    return [k * PERIOD_S for k in range(cycles)]


def test_reference_is_as_it_is_where_no_mode_is_known() -> None:
    """To the bit, and asked for once, at the instant itself."""
    reference = Asked(math.sin)
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


def test_gain_at_the_mode_is_what_the_weights_say() -> None:
    """A reference that swings at the mode of 734 Hz, in samples of 1 kHz, keeps a third."""
    angle = math.tau * MODE_HZ

    swing = shaped(lambda t_s: cmath.exp(1j * angle * t_s).real, every_period(200))

    assert max(map(abs, swing)) == pytest.approx(1.0 - 0.6 * (1.0 - math.cos(1e-3 * angle)), 1e-2)
    assert max(map(abs, swing)) < 0.35


def test_mode_at_half_the_rate_is_taken_out() -> None:
    """There a quarter of each neighbour is enough."""
    corners = CornerFilter(lambda t_s: math.cos(math.tau * 500.0 * t_s), 500.0, PERIOD_S)

    swing = [corners.value(t_s) for t_s in every_period(50)]

    assert swing == pytest.approx([0.0] * 50, abs=1e-9)


def test_straight_line_is_left_as_it_is_and_nothing_is_late() -> None:
    """A mean with both neighbours has no phase."""
    times_s = every_period(50)

    assert shaped(lambda t_s: 3.0 - 40.0 * t_s, times_s) == pytest.approx(
        [3.0 - 40.0 * t_s for t_s in times_s], abs=1e-12
    )


def test_corner_is_off_by_share_times_jump_of_speed_times_period() -> None:
    """At the corner alone; one cycle before and after nothing is left of it."""
    off = np.subtract(shaped(corner, every_period(21)), [*map(corner, every_period(21))])

    assert off[10] == pytest.approx(0.3 * 1.0 * PERIOD_S)
    assert np.delete(off, 10) == pytest.approx(0.0, abs=1e-12)


def test_reference_is_asked_for_once_in_a_cycle() -> None:
    """One period further ahead; all three values only in the first cycle."""
    reference = Asked(corner)

    shaped(reference, every_period(4))

    assert reference.times_s == pytest.approx([-1e-3, 0.0, 1e-3, 2e-3, 3e-3, 4e-3])


@pytest.mark.parametrize("gap", [0.0, 0.5, 0.7, 1.3, 2.0, 5.0])
def test_neighbours_are_one_period_away_after_a_gap_too(gap: float) -> None:
    """Whatever was skipped, the value is that of a filter that starts there."""
    there = 7e-3 + gap * PERIOD_S

    after = shaped(corner, [*every_period(8), there, there + PERIOD_S])[-2:]

    assert after == pytest.approx(shaped(corner, [there, there + PERIOD_S]), abs=1e-15)


@given(
    speeds=st.lists(st.floats(-10.0, 10.0), min_size=9, max_size=9),
    jitter=st.lists(st.floats(-0.1, 0.1), min_size=40, max_size=40),
)
def test_jitter_of_the_cycles_shifts_the_reference_by_no_more(
    speeds: list[float], jitter: list[float]
) -> None:
    """It is off by speed times jitter, beside the rounding of corners; nothing adds up."""
    bends_s = np.linspace(0.0, 0.04, 10)
    values = np.concatenate(([0.0], np.cumsum(speeds) * bends_s[1]))
    times_s = [(k + part) * PERIOD_S for k, part in enumerate(jitter)]

    def path(t_s: float) -> float:
        return float(np.interp(t_s, bends_s, values))

    off = np.subtract(shaped(path, times_s), [*map(path, times_s)])

    assert np.abs(off).max() <= 10.0 * PERIOD_S * (0.3 * 2.0 + 4 * 0.1)
