"""Movements of user axes as displacements of actuators."""

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.reference.motion import Motion, joined, rest_at
from piezod.control.reference.user_path import UserPath
from piezod.coordinates.frame import frame_of
from piezod.coordinates.matrices import identity
from piezod.coordinates.paths import outside

FRAME = frame_of(((1.0, 0.5), (1.0, -0.5)), None, identity(2), identity(2), (0.0, 0.0))
LOW, HIGH = [0.0, 0.0], [10.0, 10.0]


def _steady(start: float, per_s: float) -> Motion:
    return Motion(lambda t_s: start + per_s * max(t_s, 0.0), 10.0, start + 10.0 * per_s)


def _path(z_per_s: float, tilt_per_s: float) -> UserPath:
    assert FRAME is not None
    motions = [(_steady(5.0, z_per_s), 0.0), (_steady(0.0, tilt_per_s), 0.0)]
    return UserPath(FRAME, motions, LOW, HIGH)


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_a_limit_stops_all_user_axes_where_they_are(z_per_s: float, tilt_per_s: float) -> None:
    """Every point lies on the path and within the limits; from the limit on nothing moves."""
    assert FRAME is not None
    path = _path(z_per_s, tilt_per_s)
    for k in range(101):
        t_s = 0.1 * k
        actuators_um = path.actuators(t_s)
        assert outside(actuators_um, LOW, HIGH) is None
        z, tilt = FRAME.user(actuators_um)
        assert (z - 5.0) * tilt_per_s == pytest.approx(tilt * z_per_s, abs=1e-6)
        if t_s < path.stops_s:
            assert z == pytest.approx(5.0 + z_per_s * t_s, abs=1e-6)


def test_an_actuator_goes_on_for_what_others_move_later() -> None:
    """At a steady speed it is the way of that time, times the share; also from the start on."""
    assert FRAME is not None
    motions = [(_steady(5.0, 2.0), 0.0), (rest_at(0.0), 0.0)]
    path = UserPath(FRAME, motions, LOW, HIGH, (((1, 0.03, 0.01),), ()))
    for t_s in (0.0, 0.005, 1.0):
        assert path.late_um(0, t_s) == pytest.approx(0.03 * 2.0 * 0.01)
        assert path.late_um(1, t_s) == 0.0
    first = path.references()[0]
    assert first(1.0) == pytest.approx(7.0 + 0.03 * 2.0 * 0.01)


def test_a_path_within_its_limits_does_not_stop() -> None:
    """A path that stays inside has no end by a limit."""
    path = _path(0.1, 0.1)
    path.actuators(10.0)
    assert path.stops_s == inf


def test_a_start_beyond_a_limit_may_come_back() -> None:
    """Creep may have brought an actuator out of its range; the way back is free."""
    assert FRAME is not None
    path = UserPath(FRAME, [(_steady(-0.5, 1.0), 0.0), (rest_at(0.0), 0.0)], LOW, HIGH)
    assert path.actuators(2.0) == pytest.approx([1.5, 1.5])
    back = UserPath(FRAME, [(_steady(-0.5, -1.0), 0.0), (rest_at(0.0), 0.0)], LOW, HIGH)
    assert back.actuators(2.0) == pytest.approx([-0.5, -0.5])


def test_joined_movements_follow_each_other() -> None:
    """The second movement begins when the first one ends."""
    both = joined([Motion(lambda t_s: min(t_s, 2.0), 2.0, 2.0), _steady(2.0, 3.0)])
    assert [both.reference_um(t_s) for t_s in (1.0, 2.0, 3.0)] == pytest.approx([1.0, 2.0, 5.0])
    assert both.duration_s == 12.0
