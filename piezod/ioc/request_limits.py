"""What may be written to a record: range and length of the field of a request that it becomes."""

from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel

from piezod.config.fields import Quantity


def range_of(request: type[BaseModel], field: str) -> tuple[float, float]:
    """Return the lowest and the highest value; of a table, of the values of its points.

    Args:
        request: A request, or a part of one.
        field: Name of a field that is a number, or a table of numbers.
    """
    info = request.model_fields[field]
    notes = _notes(info.annotation, info.metadata)
    *_, quantity = (each for each in notes if isinstance(each, Quantity))
    return quantity.low, quantity.high


def longest(request: type[BaseModel], field: str) -> int:
    """Return the largest number of elements of a table; arguments as for `range_of`."""
    info = request.model_fields[field]
    (found,) = (each.max_length for each in info.metadata if hasattr(each, "max_length"))
    return int(found)


def _notes(annotation: Any, metadata: list[Any]) -> Iterator[Any]:
    """Yield what annotates a type, then what annotates its parts."""
    yield from metadata
    for part in get_args(annotation):
        yield from _notes(part, list(getattr(part, "__metadata__", ())))
