"""The metrics on shapes whose result is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.hysteresis import (
    MPIModel,
    asymmetry,
    loop_width,
    nonlinearity,
    tracking_max,
    tracking_rms,
)

TIMES = np.linspace(0, 1, 1001)
RISING = np.linspace(0, 1, 501)
LOOP = np.concatenate((RISING, RISING[-2::-1]))  # up and down again
SCALE = st.floats(0.01, 100)


def test_tracking_errors_of_a_constant_offset() -> None:
    """An offset of 0.5 µm over a range of 10 µm is 5 %, worst and rms."""
    command = 10 * TIMES

    assert tracking_max(command, command + 0.5) == pytest.approx(0.05)
    assert tracking_rms(command, command + 0.5) == pytest.approx(0.05)


def test_tracking_errors_of_a_sine() -> None:
    """An error of amplitude a has a worst value of a and a root mean square of a / √2."""
    command = 10 * TIMES
    position = command + 0.1 * np.sin(20 * np.pi * TIMES)

    assert tracking_max(command, position) == pytest.approx(0.01, rel=1e-3)
    assert tracking_rms(command, position) == pytest.approx(0.01 / np.sqrt(2), rel=1e-3)


def test_errors_are_shares_of_the_measured_range() -> None:
    """The range is that of the displacement, not of the command."""
    assert tracking_max([0.0, 1.0], [0.0, 2.0]) == 0.5


@given(slope=SCALE, offset=st.floats(-100, 100))
def test_nonlinearity_of_a_line_is_zero(slope: float, offset: float) -> None:
    """Scale and offset are not hysteresis errors."""
    assert nonlinearity(TIMES, slope * TIMES + offset) == pytest.approx(0, abs=1e-9)


def test_nonlinearity_of_a_parabola_is_known() -> None:
    """The best line through x² on [0, 1] is x - 1/6; it deviates by 1/6 at the ends."""
    assert nonlinearity(TIMES, TIMES**2) == pytest.approx(1 / 6, rel=1e-2)


def test_nonlinearity_of_two_branches_is_half_their_distance() -> None:
    """Two parallel lines 0.1 apart deviate by 0.05 from the line between them."""
    position = LOOP + np.where(np.arange(LOOP.size) < 501, -0.05, 0.05)

    assert nonlinearity(LOOP, position) == pytest.approx(0.05 / 1.1, rel=1e-2)


def test_loop_of_one_right_play_has_the_width_of_the_formula() -> None:
    """One operator at r with weight q makes a loop of width q r, at the threshold."""
    mpi = MPIModel([0.4], [0.3], [0.0])

    assert loop_width(LOOP, mpi.run(LOOP)) == pytest.approx(0.3 * 0.4, rel=1e-2)


def test_widths_of_both_sides_add_up() -> None:
    """With equal weights at r = 1/2 both sides lag most in the middle."""
    mpi = MPIModel([0.5], [0.1], [0.1])

    assert loop_width(LOOP, mpi.run(LOOP)) == pytest.approx(2 * 0.1 * 0.5, rel=1e-2)


def test_asymmetry_is_zero_if_both_sides_are_equal() -> None:
    """The falling branch mirrors the rising one through the middle."""
    mpi = MPIModel([0.25, 0.6], [0.1, 0.05], [0.1, 0.05])

    assert asymmetry(LOOP, mpi.run(LOOP)) == pytest.approx(0, abs=1e-12)


def test_asymmetry_of_one_side_is_its_width() -> None:
    """If one branch is straight, the whole width of the loop is asymmetry."""
    mpi = MPIModel([0.4], [0.3], [0.0])

    x = mpi.run(LOOP)

    assert asymmetry(LOOP, x) == pytest.approx(loop_width(LOOP, x), rel=1e-9)


@given(volts=SCALE, microns=SCALE, offset=st.floats(-100, 100))
def test_shape_of_a_loop_does_not_depend_on_units(
    volts: float, microns: float, offset: float
) -> None:
    """Width and asymmetry are shares of the range, in any unit and with any offset."""
    x = MPIModel([0.4, 0.7], [0.2, 0.1], [0.05, 0.0]).run(LOOP)
    drive, position = offset + volts * LOOP, offset + microns * x

    assert loop_width(drive, position) == pytest.approx(loop_width(LOOP, x), abs=1e-6)
    assert asymmetry(drive, position) == pytest.approx(asymmetry(LOOP, x), abs=1e-6)
