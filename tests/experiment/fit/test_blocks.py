"""Tests of the comparison of two fits on held-out blocks."""

import numpy as np
import pytest

from piezod.experiment.fit.blocks import clearly_better

ERRORS = np.array([4.0, 1.0, 1.0, 1.0, 9.0])


@pytest.mark.parametrize(
    ("ratios", "better"),
    [
        ((0.5, 0.6, 0.5, 0.7, 0.5), True),
        ((0.9, 0.9, 0.9, 0.9, 0.3), True),  # most in the block with the largest error
        ((0.3, 3.0, 0.9, 2.0, 0.3), False),  # smaller on average, by chance
        ((0.9, 0.9, 0.9, 0.9, 0.9), False),  # by less than asked for
        ((1.0, 1.0, 1.0, 1.0, 1.0), False),
    ],
)
def test_a_fit_is_better_if_its_blocks_agree(ratios: tuple[float, ...], better: bool) -> None:
    """The mean must become smaller by the ratio, and the share that a block gains be no chance."""
    squares = (ERRORS * ratios) ** 2

    assert clearly_better(squares, ERRORS**2, 0.8) == better
