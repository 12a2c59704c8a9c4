"""Tests of the guard's wait for an output that does not follow its writes."""

from collections.abc import Sequence
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.guard import Guard, Limits
from tests.control.guard_properties import told

SLOW = Limits(drive_min_v=0.0, drive_max_v=150.0, slew_v_per_s=400.0)
"""Steps of 2 V in a cycle of 5 ms; the tolerance is 0.75 V."""
CYCLE_S, STEP_V, TOLERANCE_V = 5e-3, 2.0, 0.75
VOLTS = st.floats(0.0, 150.0)
ANY = st.one_of(VOLTS, st.sampled_from([nan, inf, -inf]))


def guard() -> Guard:
    """Return a guard of two such axes, of one amplifier."""
    return Guard([SLOW, SLOW], CYCLE_S)


@given(asked_v=ANY, in_force_v=VOLTS, read_back_v=ANY, stale=st.booleans())
def test_no_write_is_far_from_a_live_read_back(
    asked_v: float, in_force_v: float, read_back_v: float, stale: bool
) -> None:
    """It is at most a step and the tolerance away, or nothing is written; nothing is dragged."""
    admitted = guard().admit(
        1 if stale else 0,
        0,
        [asked_v] * 2,
        [in_force_v] * 2,
        CYCLE_S,
        read_back_v=[read_back_v] * 2,
    )
    free = guard().admit(1 if stale else 0, 0, [asked_v] * 2, [in_force_v] * 2, CYCLE_S)

    for drive_v, free_v in zip(admitted.drive_v, free.drive_v, strict=True):
        assert drive_v in (free_v, in_force_v)
        if admitted.writable and abs(read_back_v) < inf:
            assert abs(drive_v - read_back_v) <= STEP_V + TOLERANCE_V
    if not abs(read_back_v) < inf:
        assert told(admitted) == told(free)


@pytest.mark.parametrize(
    ("asked_v", "in_force_v", "read_back_v", "drive_v", "writable", "waits"),
    [
        (60.0, 60.0, 60.0, 60.0, True, ()),
        (62.0, 60.0, 59.25, 62.0, True, ()),  # just in reach
        (62.0, 60.0, 59.24, 60.0, True, (0,)),
        (58.0, 60.0, 60.76, 60.0, True, (0,)),
        (58.0, 60.0, 62.75, 60.0, True, (0,)),  # the last write is just in reach
        (58.0, 60.0, 62.76, 60.0, False, (0,)),
        (60.0, 60.0, 40.0, 60.0, False, (0,)),
    ],
)
def test_wait_begins_at_the_reach(
    asked_v: float,
    in_force_v: float,
    read_back_v: float,
    drive_v: float,
    writable: bool,
    waits: tuple[int, ...],
) -> None:
    """The axis keeps its last write; beyond the reach of that, too, nothing is written."""
    admitted = guard().admit(
        0, 0, [asked_v, 10.0], [in_force_v, 10.0], CYCLE_S, read_back_v=[read_back_v, nan]
    )

    assert (admitted.drive_v, admitted.writable) == ([drive_v, 10.0], writable)
    assert (admitted.waits, admitted.refused, admitted.stale) == (waits, (), False)


def test_every_axis_waits_for_its_own_output() -> None:
    """One that is out of reach holds the writes of all back, in any order; others stay refused."""
    first = guard().admit(0, 0, [10.0, 12.0], [10.0, 10.0], CYCLE_S, read_back_v=[50.0, 9.0])
    second = guard().admit(0, 0, [12.0, 10.0], [10.0, 10.0], CYCLE_S, read_back_v=[9.0, 50.0])
    refused = guard().admit(0, 0, [nan, 10.0], [nan, 10.0], CYCLE_S, read_back_v=[nan, 9.0])

    assert (first.writable, first.waits, first.drive_v) == (False, (0, 1), [10.0, 10.0])
    assert (second.writable, second.waits) == (False, (0, 1))
    assert (refused.writable, refused.waits, refused.refused) == (False, (), (0,))


def test_old_read_back_has_a_longer_reach() -> None:
    """Since then the output may have gone as far as the slew rate allows; each axis by its own."""
    old = guard().admit(
        0, 0, [62.0] * 2, [60.0] * 2, CYCLE_S, read_back_v=[57.3] * 2, age_s=[5e-3, 0.0]
    )

    assert (old.waits, old.held) == ((1,), ())


@pytest.mark.parametrize("doubted", [0, 1, 2])
@pytest.mark.parametrize("known", [True, False])
def test_only_the_axes_of_the_same_amplifier_wait_for_each_other(doubted: int, known: bool) -> None:
    """An output that is out of reach, or unknown, holds back what is written together with it."""
    amplifiers = ["a", "b", "a"]
    in_force_v, read_back_v = [10.0] * 3, [10.0] * 3
    read_back_v[doubted] = 50.0 if known else nan
    in_force_v[doubted] = 10.0 if known else nan
    admitted = Guard([SLOW] * 3, CYCLE_S, amplifiers).admit(
        0, 0, [12.0] * 3, in_force_v, CYCLE_S, read_back_v=read_back_v
    )

    together = [i for i in range(3) if amplifiers[i] == amplifiers[doubted]]
    assert list(admitted.held) == together
    assert not admitted.writable
    free = [i for i in range(3) if i != doubted]
    assert [admitted.drive_v[i] for i in free] == [12.0] * 2


@pytest.mark.parametrize("left", [0, 1, 2])
@pytest.mark.parametrize("read_back_v", [None, [10.0] * 3])
def test_axis_that_is_left_alone_is_not_written(
    left: int, read_back_v: Sequence[float] | None
) -> None:
    """Nor is what is written together with it; nothing is left alone unless it is asked for."""
    amplifiers = ["a", "b", "a"]
    guard = Guard([SLOW] * 3, CYCLE_S, amplifiers)
    asked = 0, 0, [10.0] * 3, [10.0] * 3, CYCLE_S
    admitted = guard.admit(*asked, read_back_v=read_back_v, left=[left])
    free = guard.admit(*asked, read_back_v=read_back_v)

    assert list(admitted.held) == [i for i in range(3) if amplifiers[i] == amplifiers[left]]
    assert list(free.held) == []


def test_stale_plan_waits_too() -> None:
    """A voltage that is kept, because its plan is old, is not repeated far from the output."""
    kept = guard().admit(1, 0, [60.0] * 2, [60.0] * 2, CYCLE_S, read_back_v=[60.0, 10.0])

    assert (kept.stale, kept.writable, kept.waits) == (True, False, (1,))


def test_guard_without_ages_takes_any_number_of_axes() -> None:
    """The read-back of each axis is then of the present cycle."""
    plain = Guard([SLOW] * 3, CYCLE_S)
    admitted = plain.admit(0, 0, [2.0] * 3, [0.0] * 3, CYCLE_S, read_back_v=[0.0, -0.75, -0.76])

    assert admitted.waits == (2,)
