"""The guard of tables, the last check before a table is loaded."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from piezod.control.guard import Limits
from piezod.control.table_guard import FloatArray, TableGuard
from piezod.devices.played_axis import AxisTable
from piezod.devices.player import AtEnd
from piezod.errors import DataError

LIMITS = Limits(0.0, 150.0, 20_000.0)
INTERVAL_NS = 50_000
REACH_V = 1.0  # 20000 V/s for 50 µs
REST_V = 5.0
HOLDS = TableGuard(LIMITS, REST_V, AtEnd.HOLDS, 1000)
RESTS = TableGuard(LIMITS, REST_V, AtEnd.RESTS, 1000)
UNKNOWN = TableGuard(LIMITS, REST_V, AtEnd.UNKNOWN, 1000)

VOLTS = st.one_of(
    st.floats(-2.0, 152.0), st.sampled_from([0.0, 150.0, nan, inf, -inf, -1e-12, 1e300])
)
STEPS = st.floats(-1.2, 1.2)


def table(lead_in_v: object, period_v: object, cycles: int = 3) -> AxisTable:
    """Return a table of these voltages."""
    return AxisTable(INTERVAL_NS, np.array(lead_in_v, float), np.array(period_v, float), cycles)


def walks(size: int) -> st.SearchStrategy[FloatArray]:
    """Return tables of which many obey the limits: walks of small steps from the middle."""
    steps = hnp.arrays(np.float64, st.integers(1, size), elements=STEPS)
    return steps.map(lambda each: 75.0 + np.cumsum(each))


def played(one: AxisTable, in_force_v: float) -> FloatArray:
    """Return every voltage of a play, from the one in force to the end."""
    return np.concatenate(([in_force_v], one.lead_in_v, np.tile(one.period_v, one.cycles)))


def accepted(guard: TableGuard, one: AxisTable, in_force_v: float) -> bool:
    """Return whether a guard accepts a table."""
    try:
        guard.check(one, in_force_v)
    except DataError:
        return False
    return True


def is_safe(one: AxisTable, in_force_v: float) -> bool:
    """Return whether a play obeys the limits, by playing it point by point."""
    values = played(one, in_force_v)
    inside = np.all((values[1:] >= 0.0) & (values[1:] <= 150.0))
    return bool(inside and np.all(np.abs(np.diff(values)) <= REACH_V * (1 + 1e-9)))


@given(st.one_of(walks(6), hnp.arrays(np.float64, st.integers(0, 4), elements=VOLTS)),
       st.one_of(walks(12), hnp.arrays(np.float64, st.integers(1, 6), elements=VOLTS)),
       st.integers(1, 3), st.floats(70.0, 80.0))  # fmt: skip
@example(np.array([75.0]), np.array([75.0, 76.0]), 2, 75.0)
@example(np.array([75.0]), np.array([75.0, 76.0, 77.0]), 2, 75.0)  # the wrap is too fast
@example(np.empty(0), np.array([75.0, 76.0, 77.0]), 1, 75.0)  # without one
@example(np.empty(0), np.array([nan]), 1, 75.0)
def test_only_safe_plays_are_accepted(
    lead_in_v: FloatArray, period_v: FloatArray, cycles: int, in_force_v: float
) -> None:
    """A table is accepted if, and only if, every step of its play obeys the limits."""
    one = table(lead_in_v, period_v, cycles)

    assert accepted(HOLDS, one, in_force_v) == is_safe(one, in_force_v)


@given(walks(12), st.integers(1, 3))
@example(np.array([5.5, 4.5, 5.5]), 2)
def test_end_of_a_device_that_may_go_to_rest(period_v: FloatArray, cycles: int) -> None:
    """If the device goes to rest at its end, or may, the last point must be within reach of it."""
    period_v = period_v - period_v[0] + REST_V
    one = table([], period_v, cycles)
    assume(is_safe(one, REST_V))
    near = bool(abs(period_v[-1] - REST_V) <= REACH_V * (1 + 1e-9))

    assert accepted(HOLDS, one, REST_V)
    assert accepted(RESTS, one, REST_V) == near
    assert accepted(UNKNOWN, one, REST_V) == near


@pytest.mark.parametrize(
    ("one", "in_force_v", "text"),
    [
        (table([75], [75, 151]), 75, "point 1 of the period is 151 V, allowed range 0 to 150 V"),
        (table([75, nan], [75]), 75, "point 1 of the lead-in is nan V"),
        (
            table([75, 77], [77]),
            75,
            r"from point 0 of the lead-in to point 1 of the lead-in the voltage goes from 75 to "
            r"77 V in 50 µs, 4e\+04 V/s, allowed: at most 20000 V/s; slow the command down",
        ),
        (table([75], [77]), 75, "from point 0 of the lead-in to point 0 of the period"),
        (table([], [75, 76, 77]), 75, "from the last point of the period to its first.*close"),
        (table([80], [80]), 75, "from the voltage in force to the first point.*75 to 80 V.*begin"),
        (table([75], [75]), nan, "from the voltage in force to the first point"),
        (table([75], [75], cycles=1001), 75, "1001 cycles, the device plays at most 1000"),
        (table([75], []), 75, "0 points in its period"),
        (table([75], [75], cycles=0), 75, "0 cycles"),
    ],
)
def test_refusal_names_point_value_limit_and_remedy(
    one: AxisTable, in_force_v: float, text: str
) -> None:
    """The first problem is reported, with what to do."""
    with pytest.raises(DataError, match=text):
        HOLDS.check(one, in_force_v)


def test_device_without_a_number_of_cycles() -> None:
    """If only the host can end a play, any number of cycles is accepted."""
    endless = TableGuard(LIMITS, REST_V, AtEnd.HOLDS, 0)

    endless.check(table([], [5.0], cycles=10**6), 5.0)
