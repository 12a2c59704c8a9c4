"""The map between a physical range and [0, 1]."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.errors import ModelError
from piezod.hysteresis import AffineRange

ENDS = st.floats(-1e6, 1e6)


def test_ends_of_a_range_become_zero_and_one() -> None:
    """The range from -10 V to 150 V is 160 V wide, and 70 V is its middle."""
    drive_v = AffineRange.checked(-10, 150)

    assert drive_v.width == 160
    assert (drive_v.to_unit(-10.0), drive_v.to_unit(70.0), drive_v.to_unit(150.0)) == (0, 0.5, 1)
    assert (drive_v.from_unit(0.0), drive_v.from_unit(0.5), drive_v.from_unit(1.0)) == (
        -10,
        70,
        150,
    )


@given(low=ENDS, width=st.floats(1e-3, 1e6), value=ENDS)
def test_there_and_back_is_the_identity(low: float, width: float, value: float) -> None:
    """This holds for values outside the range too."""
    affine = AffineRange.checked(low, low + width)

    back = affine.from_unit(affine.to_unit(value))

    assert back == pytest.approx(value, rel=1e-9, abs=1e-9 * (1 + abs(low)))


def test_arrays_are_mapped_element_by_element() -> None:
    """Arrays of records are normalised in one call."""
    affine = AffineRange.checked(1.0, 3.0)

    assert affine.to_unit(np.array([1.0, 2.0, 4.0])).tolist() == [0.0, 0.5, 1.5]
    assert affine.from_unit(np.array([0.0, 0.5, 1.5])).tolist() == [1.0, 2.0, 4.0]


@pytest.mark.parametrize(
    ("low", "high"), [(1, 1), (2, 1), (0, float("inf")), (float("nan"), 1), (-1e308, 1e308)]
)
def test_range_that_cannot_be_divided_by_is_refused(low: float, high: float) -> None:
    """The message states both ends."""
    with pytest.raises(ModelError, match=r"must be finite and increase, got .* to "):
        AffineRange.checked(low, high)
