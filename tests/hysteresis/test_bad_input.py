"""Invalid arguments: every refusal states the given value and the allowed range."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from piezod.errors import ModelError
from piezod.hysteresis import (
    LMSIdentifier,
    MPIModel,
    even_thresholds,
    identify_least_squares,
    largest_stable_gain,
    new_bank,
)

BANK = new_bank(even_thresholds(5), even_thresholds(5))
RAMP = np.linspace(0.0, 1.0, 50)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: MPIModel([0.5], [0.1], [0.1], deadband=-0.1), "dead-band is from 0 to below 1"),
        (lambda: LMSIdentifier(BANK, deadband=math.nan), "dead-band is from 0 to below 1"),
        (
            lambda: MPIModel([0.5], [0.1], [0.1]).run(np.eye(2)),
            r"one dimension, got shape \(2, 2\)",
        ),
        (lambda: LMSIdentifier(BANK).run(RAMP, RAMP[1:]), "as many drives as positions"),
        (lambda: even_thresholds(0), "an integer of at least 1, got 0"),
        (lambda: LMSIdentifier(BANK, gain=-0.1), "gain of -0.1 is out of range"),
        (lambda: LMSIdentifier(BANK, gain=math.nan), "gain of nan is out of range"),
        (lambda: identify_least_squares(BANK, RAMP, RAMP[1:]), "finite drives as positions"),
        (lambda: identify_least_squares(BANK, RAMP, RAMP * math.nan), "finite drives as positions"),
        (lambda: identify_least_squares(BANK, 0.0 * RAMP, RAMP), "does not move"),
    ],
)
def test_invalid_arguments_are_refused(call: Callable[[], object], text: str) -> None:
    """The message states the rule."""
    with pytest.raises(ModelError, match=text):
        call()


@pytest.mark.parametrize(("order", "largest"), [(5, 1.645), (19, 5.904), (39, 12.03)])
def test_the_largest_stable_gain_is_that_of_the_bound(order: int, largest: float) -> None:
    """For the paper's 19 thresholds ‖E - x‖² stays below 5.9, which allows its gain of 0.1."""
    bank = new_bank(even_thresholds(order), even_thresholds(order))

    assert 1.0 / largest_stable_gain(bank) == pytest.approx(largest, rel=1e-3)


def test_whole_numbers_are_numbers() -> None:
    """A step with an integer gives the same output as a step with the float."""
    model = MPIModel([0.5], [0.1], [0.1])

    assert model.step(1) == model.copy().step(1.0) == 1.0
