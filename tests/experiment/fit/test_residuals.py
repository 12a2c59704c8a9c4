"""Tests of the comparison of two fits on held-out blocks."""

import numpy as np
import pytest

from piezod.experiment.fit.residuals import clearly_better

ERRORS = np.array([4.0, 1.0, 1.0, 1.0, 9.0])


@pytest.mark.parametrize(
    ("ratios", "better"),
    [
        ((0.5, 0.6, 0.5, 0.7, 0.5), True),
        ((0.8, 0.9, 0.7, 0.6, 0.4), True),
        ((0.3, 3.0, 0.9, 2.0, 0.3), False),  # smaller on average, by chance
        ((0.7, 0.7, 3.2, 0.5, 0.7), False),  # an easy block objects
        ((1.0, 1.0, 1.0, 1.0, 0.3), False),  # one block alone
        ((0.9, 0.9, 0.9, 0.9, 0.9), False),  # by less than asked for
    ],
)
def test_a_fit_is_better_if_its_blocks_agree(ratios: tuple[float, ...], better: bool) -> None:
    """The rms of all blocks must become smaller by the ratio, and most blocks must agree."""
    squares = (ERRORS * ratios) ** 2

    assert clearly_better(squares, ERRORS**2, 0.8, 2.0) == better


def test_some_blocks_may_gain_nothing() -> None:
    """With one standard error the gain may be that of half of the blocks, as after jumps."""
    squares = (ERRORS * (1.01, 1.02, 0.8, 0.3, 0.3)) ** 2

    assert clearly_better(squares, ERRORS**2, 0.9, 1.0)
    assert not clearly_better(squares, ERRORS**2, 0.9, 2.0)
