"""The text format of GCS 2: lines and single bytes of a client, arguments, replies."""

import re
from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Final

from piezod.gcs.errors import Code, GcsRefusal

IS_MOVING, IS_READY, STOP_ALL = "#5", "#7", "#24"
LONGEST: Final = 256
"""Length of the longest line, in bytes."""
ENCODING: Final = "cp1252"
_BYTES: Final = {0x05: IS_MOVING, 0x07: IS_READY, 0x18: STOP_ALL}
_SPLIT: Final = re.compile(rb"([\x05\x07\x18\n])")
_NUMBER: Final = re.compile(r"[+-]?(\d{1,12}(\.\d{0,12})?|\.\d{1,12})([eE][+-]?\d{1,2})?")


class LineBuffer:
    """Makes commands from the bytes of a client.

    A line ends with a line feed. Commands of a single byte need none, and do not end a line.
    """

    def __init__(self) -> None:
        self._line = b""

    def feed(self, data: bytes) -> Iterator[str]:
        """Take the next bytes; yield the commands that they complete, a single byte by its name.

        A line that is too long is yielded with one byte more than `LONGEST`.
        """
        for chunk in _SPLIT.split(data):
            if chunk == b"\n":
                line, self._line = self._line, b""
                yield line.decode(ENCODING, "replace")
            elif chunk and chunk[0] in _BYTES:
                yield _BYTES[chunk[0]]
            else:
                self._line = (self._line + chunk)[: LONGEST + 1]


def ids_in(arguments: str, axes: Sequence[str]) -> list[str]:
    """Return the identifiers in the arguments; all of them if there are none.

    Raises:
        GcsRefusal: If an identifier is unknown.
    """
    return [known(each, axes) for each in arguments.split()] or list(axes)


def known(axis: str, axes: Sequence[str]) -> str:
    """Return an identifier.

    Raises:
        GcsRefusal: If it is unknown.
    """
    if axis not in axes:
        why = f"no axis {axis}, the axes are {', '.join(axes)}"
        raise GcsRefusal(Code.UNKNOWN_AXIS, why)
    return axis


def pairs_in(arguments: str, axes: Sequence[str]) -> dict[str, float]:
    """Return the identifiers and numbers in the arguments.

    Raises:
        GcsRefusal: If an identifier is unknown, a number is invalid, or one of them is missing.
    """
    words = arguments.split()
    if not words or len(words) % 2:
        raise GcsRefusal(Code.WRONG_COUNT, "needs an axis and a number, or several such pairs")
    pairs = zip(words[::2], words[1::2], strict=True)
    return {known(axis, axes): number_in(text) for axis, text in pairs}


def number_in(text: str) -> float:
    """Return the number in an argument.

    Raises:
        GcsRefusal: If it is not a finite number.
    """
    if not _NUMBER.fullmatch(text) or not isfinite(number := float(text)):
        raise GcsRefusal(Code.NOT_A_NUMBER, f"{text!r} is not a number")
    return number


def lines(texts: Sequence[str]) -> str:
    """Return a reply; a space before the line feed announces another line."""
    return " \n".join(texts) + "\n"
