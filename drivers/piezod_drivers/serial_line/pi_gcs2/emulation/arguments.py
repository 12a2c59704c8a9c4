"""Reads the arguments of commands with several numbers, and writes lines of replies."""

from collections.abc import Callable, Iterable
from typing import TypeVar

from piezod_drivers.serial_line.gcs.emulator import GcsRefusal

ValueT = TypeVar("ValueT")

_WRONG, _WORDS, _NOT_A_NUMBER = 17, 24, 25


def whole(text: str) -> int:
    """Return a whole number, decimal or with 0x before it.

    Raises:
        GcsRefusal: If it is none.
    """
    try:
        return int(text, 0)
    except ValueError:
        raise GcsRefusal(_NOT_A_NUMBER) from None


def number(text: str) -> float:
    """Return a decimal number.

    Raises:
        GcsRefusal: If it is none.
    """
    try:
        return float(text)
    except ValueError:
        raise GcsRefusal(_NOT_A_NUMBER) from None


def pairs(text: str, convert: Callable[[str], ValueT]) -> list[tuple[str, ValueT]]:
    """Return identifiers with the value behind each.

    Raises:
        GcsRefusal: If there are none, or a value is missing or wrong.
    """
    words = text.split()
    if not words or len(words) % 2:
        raise GcsRefusal(_WORDS)
    return [(i, convert(value)) for i, value in zip(words[::2], words[1::2], strict=True)]


def span(text: str) -> tuple[int, int, list[str]]:
    """Return first point, number of points and tables of a query of many values.

    Raises:
        GcsRefusal: If one of them is missing or wrong.
    """
    first, n_points, *tables = text.split() if len(text.split()) > 2 else ["", "", ""]
    if whole(first) < 1 or whole(n_points) < 1:
        raise GcsRefusal(_WRONG)
    return whole(first), whole(n_points), tables


def lines(items: Iterable[tuple[object, object]]) -> bytes:
    """Return a line for each item; all but the last end with a space."""
    return (" \n".join(f"{name}={value}" for name, value in items) + "\n").encode()
