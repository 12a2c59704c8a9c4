"""User axes in a recording."""

import json

import numpy as np
import pytest

from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.reader import RecordedTelemetry
from piezod.records.recording.user_axes import contour_error, plane_of, user_units

TRANSFORM = {
    "transform": {"axes": {"x": {}, "y": {"unit": "µm"}, "r": {"unit": "µrad"}}},
}
RATE_HZ = 1000.0


def recording(late_cycles: int, inside: float) -> RecordedTelemetry:
    """Return a circle of 5 µm that the stage follows later, on a smaller circle."""
    turns = 2.0 * np.pi * np.arange(2000) / 1000.0
    late = turns - 2.0 * np.pi * late_cycles / 1000.0
    axes = {
        "x": {"command_um": 5.0 * np.cos(turns), "position_um": (5.0 - inside) * np.cos(late)},
        "y": {"command_um": 5.0 * np.sin(turns), "position_um": (5.0 - inside) * np.sin(late)},
    }
    notes = {"configuration": json.dumps(TRANSFORM)}
    header = TelemetryHeader("", ("a", "x", "y", "r"), RATE_HZ, "", 0, notes=notes)
    cycles = {"t_s": np.arange(2000) / RATE_HZ}
    return RecordedTelemetry(header, 0, np.zeros((0, 2), np.int64), cycles, axes, {})


def test_units_and_planes_are_those_of_the_configuration() -> None:
    """User axes of one unit make a plane; a single one makes none."""
    header = recording(0, 0.0).header
    assert user_units(header) == {"x": "µm", "y": "µm", "r": "µrad"}
    assert plane_of(header, "y") == ("x", "y")
    assert plane_of(header, "r") == ()
    assert plane_of(header, "a") == ()


@pytest.mark.parametrize("inside", [0.0, 0.1])
def test_being_late_is_no_contour_error(inside: float) -> None:
    """A stage that follows 20 ms later is on the path; on a smaller circle it is off by that."""
    found = contour_error(recording(20, inside), ("x", "y"))
    assert found[100:] == pytest.approx(inside, abs=2e-4)


def test_an_unknown_position_has_no_contour_error() -> None:
    """Without a sample or a command the distance is unknown."""
    record = recording(0, 0.0)
    record.axes["x"]["position_um"][500] = np.nan
    record.axes["y"]["command_um"][700] = np.nan
    assert np.flatnonzero(np.isnan(contour_error(record, ("x", "y")))).tolist() == [500, 700]
