"""Finds the replies to a request that ends with `ERR?`."""

import re
from itertools import islice
from math import isfinite
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.gcs.errors import fault_of

_CODE: Final = r"([+-]?[0-9]{1,5})\n"
_END: Final = re.compile(rb"(?<! )\n")
"""A line feed ends a reply, unless a space stands before it: then the reply has another line."""
_LONGEST: Final = 4096
"""No reply of which something is needed is longer, in bytes."""


class GcsReply:
    r"""The replies to some queries and to the `ERR?` behind them, taken as one frame.

    A query that the controller does not understand has no reply. A line that can be none of the
    replies is garbage.

    Args:
        *parts: Regular expression of each reply, with a group for each value; it ends with `\n`.
        whole: Whether none may be missing: where a reply looks like that to `ERR?`.
    """

    def __init__(self, *parts: str, whole: bool = False) -> None:
        maybe = "" if whole else "?"
        self._frame = re.compile(("".join(f"(?:{part}){maybe}" for part in parts) + _CODE).encode())
        self._any = re.compile("|".join((*parts, _CODE)).encode())
        self._n_replies = len(parts) + 1

    def length_of(self, data: bytes) -> int:
        """Find the frame at the beginning, as `Conversation.ask` wants it; call it in the loop."""
        if match := self._frame.match(data):
            return match.end()
        if len(data) > _LONGEST:
            return -len(data)
        ends = [end.end() for end in islice(_END.finditer(data), self._n_replies)]
        if ends and (len(ends) == self._n_replies or not self._any.fullmatch(data, 0, ends[0])):
            return -ends[0]
        return 0

    def texts(self, frame: bytes) -> list[bytes]:
        """Return the values in a frame; may be called in the loop.

        Raises:
            LineFault: The controller's error, or `GARBAGE` where a reply is missing without one.
        """
        match = self._frame.fullmatch(frame)
        if match is None:
            raise LineFault(DeviceFlag.GARBAGE, f"no reply of a controller: {frame[:80]!r}")
        *values, code = match.groups()
        if error := int(code):
            raise fault_of(error)
        if None in values:
            raise LineFault(DeviceFlag.GARBAGE, f"a reply is missing: {frame[:80]!r}")
        return values

    def numbers(self, frame: bytes) -> list[float]:
        """Return the values in a frame, all of them finite; may be called in the loop.

        Raises:
            LineFault: As `texts` does; `GARBAGE` where a number is beyond all bounds.
        """
        numbers = [float(text) for text in self.texts(frame)]
        if not all(map(isfinite, numbers)):
            raise LineFault(DeviceFlag.GARBAGE, f"no voltage or position: {frame[:80]!r}")
        return numbers
