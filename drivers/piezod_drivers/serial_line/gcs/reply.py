"""Finds and reads the replies to a request that ends with `ERR?`."""

import re
from itertools import islice
from math import isfinite
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.gcs.errors import fault_of

_CODE: Final = r"([+-]?[0-9]{1,5})\n"
_END: Final = re.compile(rb"(?<! )\n")
"""A line feed ends a reply, unless a space precedes it: then the reply has another line."""
_LONGEST: Final = 4096
"""Length of the longest reply, in bytes."""


class GcsReply:
    r"""The replies to some queries and to the `ERR?` behind them, taken as one frame.

    A query that the controller does not understand has no reply. A line that cannot be one of the
    replies is garbage.

    Args:
        *parts: Regular expression of each reply, with a group for each value; it ends with `\n`.
        whole: Whether every reply must be present, because one looks like the reply to `ERR?`.
    """

    def __init__(self, *parts: str, whole: bool = False) -> None:
        # After an error only the reply to `ERR?` comes, so the other replies are optional.
        maybe = "" if whole else "?"
        self._frame = re.compile(("".join(f"(?:{part}){maybe}" for part in parts) + _CODE).encode())
        # Any single line of the frame: a line that fits none of these is garbage.
        self._any = re.compile("|".join((*parts, _CODE)).encode())
        self._n_replies = len(parts) + 1

    def length_of(self, data: bytes) -> int:
        """Return the length of the frame, as `Conversation.ask` requires. Real-time safe."""
        if match := self._frame.match(data):
            return match.end()
        if len(data) > _LONGEST:
            return -len(data)
        # Enough lines for all replies without a match, or a first line that fits none: it is
        # garbage.
        ends = [end.end() for end in islice(_END.finditer(data), self._n_replies)]
        if ends and (len(ends) == self._n_replies or not self._any.fullmatch(data, 0, ends[0])):
            return -ends[0]
        return 0

    def texts(self, frame: bytes) -> list[bytes]:
        """Return the values of a frame. Real-time safe.

        Raises:
            LineFault: The controller's error, or `GARBAGE` if a reply is missing without an error.
        """
        match = self._frame.fullmatch(frame)
        if match is None:
            raise LineFault(DeviceFlag.GARBAGE, f"not a reply of a controller: {frame[:80]!r}")
        *values, code = match.groups()
        if error := int(code):
            raise fault_of(error)
        if None in values:
            raise LineFault(DeviceFlag.GARBAGE, f"a reply is missing: {frame[:80]!r}")
        return values

    def numbers(self, frame: bytes) -> list[float]:
        """Return the values of a frame as finite numbers. Real-time safe.

        Raises:
            LineFault: As `texts`; `GARBAGE` if a number is not finite.
        """
        numbers = [float(text) for text in self.texts(frame)]
        if not all(map(isfinite, numbers)):
            raise LineFault(DeviceFlag.GARBAGE, f"not a voltage or position: {frame[:80]!r}")
        return numbers
