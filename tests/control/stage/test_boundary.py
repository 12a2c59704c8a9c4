"""Tests of the boundary: an amplifier that is held is not written, and its last write stays."""

from math import isnan, nan

import pytest

from piezod.control.stage.boundary import DeviceBoundary
from piezod.devices.interface import Sample
from tests.control.fakes import FakeDevices


@pytest.mark.parametrize("refused", [False, True])
def test_write_of_a_held_axis_stays_the_last_one(refused: bool) -> None:
    """Acknowledged or not, it is neither repeated nor forgotten when other axes are written."""
    devices = FakeDevices([], [Sample(0, nan, False)] * 2)
    boundary = DeviceBoundary(
        devices, 2, reads_back=[True, True], holds=True, amplifiers=("a", "b")
    )
    boundary.open = True
    boundary.write([1.0, 2.0], 0)
    devices.refuses = True
    boundary.write([1.5, 2.5], 1)
    devices.refuses = refused
    boundary.write([1.5, 3.0], 2, (0,))
    sent_v = list(boundary.sent_v or ())

    assert isnan(devices.drive_v[0]) is not refused
    assert list(boundary.written_v) == [1.0, 2.0 if refused else 3.0]
    assert sent_v[0] == 1.5
    assert sent_v[1] == 3.0 if refused else isnan(sent_v[1])
