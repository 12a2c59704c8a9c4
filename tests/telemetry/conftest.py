"""A small shared memory for the tests of this room."""

from pathlib import Path

import pytest

from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import SharedMap, create

CAPACITY = 64


@pytest.fixture
def shared(tmp_path: Path) -> SharedMap:
    """Return the memory of a stage with two axes, as the supervisor creates it."""
    return create(tmp_path / "loop.map", Layout(("x", "y"), CAPACITY, 1_000_000))


def fields_of(number: int, axes: int = 2) -> list[float]:
    """Return the fields of a record in which every number is `number`, or a part of it."""
    byte = number % 256
    cycle: list[float] = [*[number] * 11, byte, True, False]
    axis: list[float] = [number, *[float(number)] * 9, byte, byte, True, number, byte]
    return cycle + axis * axes
