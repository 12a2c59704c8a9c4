"""Turns the record of a cycle into the values that the ring stores. Real-time safe."""

from enum import Enum
from typing import Any, Final, get_type_hints

from piezod.telemetry.record import AxisRecord, CycleHeader


def _enumerated(record: type[AxisRecord] | type[CycleHeader]) -> list[tuple[int, dict[int, int]]]:
    """Return the index of each enumerated field, and the index of each member by its identity.

    By identity, because hashing a member of an enumeration can call Python code.
    """
    return [
        (index, {id(member): place for place, member in enumerate(kind)})
        for index, kind in enumerate(get_type_hints(record).values())
        if issubclass(kind, Enum)
    ]


_OF_CYCLE: Final = _enumerated(CycleHeader)
_OF_AXIS: Final = _enumerated(AxisRecord)


def encode_cycle(header: CycleHeader) -> list[Any]:
    """Return the values of `layout.CYCLE_FIELDS`, gaps left out."""
    values: list[Any] = [*header]
    for index, places in _OF_CYCLE:
        values[index] = places[id(values[index])]
    return values


def encode_axis(axis: AxisRecord) -> list[Any]:
    """Return the values of `layout.AXIS_FIELDS`, gaps left out."""
    values: list[Any] = [*axis]
    for index, places in _OF_AXIS:
        values[index] = places[id(values[index])]
    return values
