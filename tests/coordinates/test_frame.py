"""The frame of a stage."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.coordinates.frame import Frame, frame_of
from piezod.coordinates.matrices import Matrix, identity, times

SHARES = st.floats(-0.05, 0.05)
TABLE: Matrix = ((1.0, 0.01, 0.0), (1.0, -0.005, 0.009), (1.0, -0.005, -0.009))
"""A table on three actuators: z, and two angles in µrad."""


def _coupling(shares: list[float]) -> Matrix:
    of_row = iter(shares)
    return tuple(tuple(1.0 if i == j else next(of_row) for j in range(3)) for i in range(3))


@st.composite
def frames(draw: st.DrawFn) -> tuple[Frame, Matrix]:
    """Draw the frame of a table, and its coupling."""
    coupling = _coupling(draw(st.lists(SHARES, min_size=6, max_size=6)))
    lever = draw(st.floats(-0.02, 0.02))
    levers = ((1.0, lever, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    offsets = draw(st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3))
    frame = frame_of(TABLE, None, coupling, levers, offsets)
    assert frame is not None
    return frame, coupling


@given(frames(), st.lists(st.floats(-100.0, 100.0), min_size=3, max_size=3))
def test_user_axes_come_back(drawn: tuple[Frame, Matrix], point: list[float]) -> None:
    """From user axes to actuators and back nothing is lost."""
    frame, _ = drawn
    assert frame.user(frame.actuators(point)) == pytest.approx(point, abs=1e-7)


@given(frames(), st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3))
def test_sensors_show_displacements_without_coupling(
    drawn: tuple[Frame, Matrix], moved_um: list[float]
) -> None:
    """What coupled actuators make the sensors show becomes the displacement of each actuator."""
    frame, coupling = drawn
    shown_um = times(coupling, moved_um)
    assert times(frame.from_sensors, shown_um) == pytest.approx(moved_um, abs=1e-9)


def test_a_lever_turns_an_angle_into_a_way() -> None:
    """A point 10 mm from the axis moves by 1 µm for 100 µrad, which the way has to make good."""
    levers = ((1.0, 0.01), (0.0, 1.0))
    frame = frame_of(identity(2), None, identity(2), levers, (0.0, 0.0))
    assert frame is not None
    assert frame.actuators([1.0, 100.0]) == pytest.approx([0.0, 100.0])


def test_sensors_at_other_places_are_turned_into_displacements() -> None:
    """Sensors that show sum and difference of two actuators give each actuator's way."""
    sensors = ((0.5, 0.5), (0.5, -0.5))  # the first one shows the sum, the second the difference
    frame = frame_of(identity(2), sensors, identity(2), identity(2), (0.0, 0.0))
    assert frame is not None
    assert times(frame.from_sensors, [3.0 + 1.0, 3.0 - 1.0]) == pytest.approx([3.0, 1.0])


def test_a_singular_matrix_has_no_frame() -> None:
    """Actuators that all do the same make no frame."""
    same = ((1.0, 1.0), (1.0, 1.0))
    assert frame_of(same, None, identity(2), identity(2), (0.0, 0.0)) is None
