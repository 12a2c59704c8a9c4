"""Parts of frozen records with arrays: read-only fields, and equality."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.errors import DataError

FloatArray: TypeAlias = npt.NDArray[np.float64]


class Comparable:
    """Equality field by field; arrays are equal if their values are, and NaN equals NaN."""

    __hash__ = None  # type: ignore[assignment]  # arrays inside: not hashable

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = [each.name for each in fields(self)]  # type: ignore[arg-type]  # subclasses are dataclasses
        return all(_same(getattr(self, name), getattr(other, name)) for name in names)


def frozen_array(values: npt.ArrayLike) -> FloatArray:
    """Return a read-only copy in double precision.

    Args:
        values: Numbers of any shape.

    Raises:
        TypeError: If they are not numbers.
        ValueError: If they are not numbers, or ragged.
    """
    # A copy, because a read-only flag on the caller's array would affect the caller too.
    frozen = np.array(values, dtype=np.float64)
    frozen.setflags(write=False)
    return frozen


def freeze(record: object, name: str, dimensions: int, where: str) -> None:
    """Replace an array of a frozen dataclass by a read-only copy.

    Args:
        record: The dataclass, from its `__post_init__`.
        name: Name of the field.
        dimensions: Required number of dimensions.
        where: Name of the record, for the message.

    Raises:
        DataError: If the field is not an array of numbers with that many dimensions.
    """
    try:
        frozen = frozen_array(getattr(record, name))
    except (TypeError, ValueError) as error:
        raise DataError(f"{where}: {name} does not consist of numbers: {error}") from error
    if frozen.ndim != dimensions:
        raise DataError(f"{where}: {name} has {frozen.ndim} dimensions; allowed is {dimensions}")
    object.__setattr__(record, name, frozen)


def freeze_columns(record: object, names: Sequence[str], where: str) -> None:
    """Replace columns of a frozen dataclass by read-only copies.

    Args:
        record: The dataclass, from its `__post_init__`.
        names: Names of the fields.
        where: Name of the record, for the message.

    Raises:
        DataError: If a column is not one-dimensional, or the columns differ in length.
    """
    for name in names:
        freeze(record, name, 1, where)
    sizes = {name: getattr(record, name).size for name in names}
    if len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
        raise DataError(f"{where}: columns differ in length ({listed}); allowed is one length")


def freeze_mapping(record: object, name: str) -> None:
    """Replace a mapping of a frozen dataclass by a read-only copy.

    Args:
        record: The dataclass, from its `__post_init__`.
        name: Name of the field.
    """
    object.__setattr__(record, name, MappingProxyType(dict(getattr(record, name))))


def _same(left: object, right: object) -> bool:
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        return np.array_equal(left, right, equal_nan=True)
    if isinstance(left, Mapping) and isinstance(right, Mapping):
        return list(left) == list(right) and all(_same(left[key], right[key]) for key in left)
    if isinstance(left, float) and isinstance(right, float):
        return left == right or (math.isnan(left) and math.isnan(right))
    return left == right
