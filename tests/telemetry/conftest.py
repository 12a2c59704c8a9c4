"""A small shared memory for the tests of this room."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from piezod.telemetry.layout import AXIS_FIELDS, CYCLE_FIELDS, Field, Layout
from piezod.telemetry.shared_map import SharedMap, create

CAPACITY = 64


@pytest.fixture
def shared(tmp_path: Path) -> SharedMap:
    """Return the memory of a stage with two axes, as the supervisor creates it."""
    return create(tmp_path / "loop.map", Layout(("x", "y"), CAPACITY, 1_000_000))


def fields_of(number: int, axes: int = 2) -> list[float]:
    """Return the fields of a record in which every number is `number`, or a part of it."""
    return values_of(CYCLE_FIELDS, number) + values_of(AXIS_FIELDS, number) * axes


def values_of(fields: Iterable[Field], number: int) -> list[float]:
    """Return the values of fields, each made of a number in the type of the field."""
    made = {"q": number, "Q": number, "d": float(number), "B": number % 256, "?": True}
    return [made[each.code] for each in fields if each.code in made]
