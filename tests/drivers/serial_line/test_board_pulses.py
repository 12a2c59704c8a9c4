"""Masks of pulses as the numbers that a board takes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.errors import DeviceError
from piezod_drivers.serial_line.piezo_board.line_pulses import LinePulses

small = st.integers(1, 6)


@given(pixels=small, per_pixel=st.integers(2, 6), turn=small, lines=small, cut=st.integers(0, 30))
def test_a_regular_mask_is_given_by_some_numbers(
    pixels: int, per_pixel: int, turn: int, lines: int, cut: int
) -> None:
    """Any part of a scan that begins in a turn has the rising edges of its mask."""
    m = pixels * per_pixel + turn
    row = np.zeros(m, np.uint8)
    row[: pixels * per_pixel : per_pixel] = 1
    row[0] |= 2
    mask = np.tile(row, lines)[min(cut, turn) * -1 % m :] if cut else np.tile(row, lines)
    mask = mask.copy()
    found = LinePulses.of(mask)
    assert np.array_equal(np.flatnonzero(mask & 1), found.rising(mask.size)[0])
    assert np.array_equal(np.flatnonzero(mask & 2), found.rising(mask.size)[1])


def test_a_frame_is_high_from_the_first_line() -> None:
    """It is told by its rows; without one it is low."""
    mask = np.zeros(20, np.uint8)
    assert LinePulses.of(mask).request == "L 0 0 0 0 0 0"
    mask[4:7] = 4
    assert LinePulses.of(mask).request == "L 0 0 0 0 4 3"


@pytest.mark.parametrize("rows", [[1, 3, 6], [0, 2, 4, 10, 12, 19]], ids=["points", "lines"])
def test_irregular_pulses_are_refused(rows: list[int]) -> None:
    """A board cannot give them."""
    mask = np.zeros(24, np.uint8)
    mask[rows] = 1
    with pytest.raises(DeviceError, match="equal distances"):
        LinePulses.of(mask)


def test_a_later_frame_is_refused() -> None:
    """A frame pulses with the first line only."""
    mask = np.zeros(24, np.uint8)
    mask[[2, 9]] = 1
    mask[5] = 4
    with pytest.raises(DeviceError, match="one frame"):
        LinePulses.of(mask)
