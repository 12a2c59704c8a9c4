"""The swings that a person sets with a few numbers, against their models."""

import pytest

from piezod.config.fields import Quantity
from piezod.config.waveforms.combined import KINDS
from piezod.config.waveforms.shapes import Enveloped
from piezod.config.waveforms.swings import SWINGS


def test_every_swing_can_be_set() -> None:
    """Each kind that swings between two values is in the table."""
    assert {kind for kind, model in KINDS.items() if issubclass(model, Enveloped)} == set(SWINGS)


@pytest.mark.parametrize("kind", SWINGS)
def test_numbers_are_the_fields_that_a_swing_needs(kind: str) -> None:
    """They are the required fields, with their ranges if these are narrower than any position's."""
    fields = KINDS[kind].model_fields
    required = {name for name, field in fields.items() if field.is_required()} - {"kind"}

    assert {number.key for number in SWINGS[kind]} == required
    for number in SWINGS[kind]:
        (allowed,) = (each for each in fields[number.key].metadata if isinstance(each, Quantity))
        if number.unit != "um":
            assert (number.low, number.high, number.unit) == (
                allowed.low, allowed.high, allowed.unit,
            )  # fmt: skip


@pytest.mark.parametrize("kind", SWINGS)
def test_first_numbers_are_a_waveform(kind: str) -> None:
    """Nobody has to set a number to get a waveform."""
    numbers = {number.key: number.start for number in SWINGS[kind]}

    assert KINDS[kind].model_validate({"kind": kind, **numbers}).built(1.0).value(0.0) == 0.0
