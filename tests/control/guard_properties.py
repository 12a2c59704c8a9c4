"""Properties that a guard has for any voltages, times and plans."""

from collections.abc import Callable, Sequence
from math import inf, isfinite, isnan, nan

from hypothesis import strategies as st

from piezod.control.guard import Admitted, Limits

LIMITS = (Limits(-10.0, 150.0, 20_000.0), Limits(0.0, 100.0, 500.0))
LONGEST_S = 2e-3
Admit = Callable[[int, int, Sequence[float], Sequence[float], float], Admitted]

_EDGES_V = (-10.0, 0.0, -0.0, 100.0, 150.0, 5e-324, 1e308, -1e308, nan, inf, -inf)
ASKED_V = st.one_of(st.floats(), st.floats(-20, 200), st.sampled_from(_EDGES_V))
IN_FORCE_V = st.one_of(st.floats(-10, 150), st.floats(-1e3, 1e3), st.sampled_from((nan, inf)))
ELAPSED_S = st.one_of(st.floats(0, 5e-3), st.floats(), st.sampled_from((0.0, 1e-3, nan, inf)))
PAIR_V = st.tuples(ASKED_V, ASKED_V)
PAIR_IN_FORCE_V = st.tuples(IN_FORCE_V, IN_FORCE_V)
_TOLD = ("drive_v", "held", "refused", "range_limited", "slew_limited", "stale", "waits")


def told(admitted: Admitted) -> list[object]:
    """Return all that the guard says."""
    return [getattr(admitted, name) for name in _TOLD]


def check_all(
    admit: Admit,
    planned_t_ns: int,
    asked_v: Sequence[float],
    in_force_v: Sequence[float],
    elapsed_s: float,
) -> None:
    """Check a guard for `LIMITS` in the cycle at 0 ns, for any arguments."""
    admitted = admit(planned_t_ns, 0, asked_v, in_force_v, elapsed_s)
    allowed_s = min(max(elapsed_s, 0.0), LONGEST_S) if isfinite(elapsed_s) else 0.0
    assert admitted.stale == (planned_t_ns != 0)
    assert admitted.writable == all(map(isfinite, in_force_v))
    assert len(admitted.drive_v) == len(LIMITS)
    for axis, limits in enumerate(LIMITS):
        before_v, after_v = in_force_v[axis], admitted.drive_v[axis]
        unusable = not (isfinite(asked_v[axis]) and isfinite(before_v))
        if admitted.stale or unusable:
            assert same(after_v, before_v)
            assert (axis in admitted.refused) == (unusable and not admitted.stale)
            continue
        check_allowed(limits, before_v, after_v, allowed_s)
        check_reported(admitted, axis, asked_v[axis], after_v)


def check_allowed(limits: Limits, before_v: float, after_v: float, allowed_s: float) -> None:
    """Check one voltage: in range, or on its way there; within the slew rate."""
    reach_v = limits.slew_v_per_s * allowed_s
    rounding_v = 1e-12 * (1.0 + abs(before_v))
    assert isfinite(after_v)
    assert abs(after_v - before_v) <= reach_v + rounding_v
    low_v, high_v = limits.drive_min_v, limits.drive_max_v
    assert after_v <= max(before_v - reach_v, high_v) + rounding_v
    assert after_v >= min(before_v + reach_v, low_v) - rounding_v
    if low_v <= before_v <= high_v:
        assert low_v <= after_v <= high_v


def check_reported(admitted: Admitted, axis: int, asked_v: float, after_v: float) -> None:
    """Check that the limited axes are reported, and only those."""
    limits = LIMITS[axis]
    outside = not limits.drive_min_v <= asked_v <= limits.drive_max_v
    limited = axis in admitted.range_limited or axis in admitted.slew_limited
    assert axis not in admitted.refused
    assert (axis in admitted.range_limited) == outside
    assert limited == (outside or after_v != asked_v)


def same(first: float, second: float) -> bool:
    """Return whether two floats are the same; NaN equals NaN."""
    return first == second or (isnan(first) and isnan(second))
