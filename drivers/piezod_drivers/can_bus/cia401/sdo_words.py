"""Channels read one by one, by SDO, in the loop."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.conversation import CanCycle
from piezod_drivers.can_bus.frame import Frame

SDO_BYTES: Final = 8
_READ: Final = 0x40
_ANSWER: Final = 0x4B
_ABORT: Final = 0x80
"""SDO: read an object; two bytes of it; there is none."""


class WordRequest(NamedTuple):
    """Asks for the word of a channel.

    Attributes:
        frames: The request.
        place: Which object it asks for; an answer repeats that.
        answers: Identifier of the answer.
    """

    frames: tuple[Frame]
    place: bytes
    answers: frozenset[int]

    def is_answered_by(self, frame: Frame) -> bool:
        """Tell whether a frame of the answer's identifier tells this object."""
        return frame.data[1:4] == self.place and frame.is_plain


def requests_for(node: int, index: int, numbers: Sequence[int]) -> list[WordRequest]:
    """Return the requests for the words of some channels.

    Args:
        node: Number of the node.
        index: Index of the object that has them.
        numbers: Sub-index of each.
    """
    answers = frozenset({objects.SDO_ANSWER + node})
    requests = []
    for number in numbers:
        place = bytes((*index.to_bytes(2, "little"), number))
        frame = Frame(objects.SDO_REQUEST + node, bytes((_READ, *place, 0, 0, 0, 0)))
        requests.append(WordRequest((frame,), place, answers))
    return requests


def read_words(cycle: CanCycle, requests: Sequence[WordRequest]) -> list[int]:
    """Read the 16 bits of each channel, one after the other; may be called in the loop.

    Raises:
        LineFault: If the node does not answer in time, refuses, or answers something else, or the
            bus fails.
    """
    return [_read_word(cycle, request) for request in requests]


def _read_word(cycle: CanCycle, request: WordRequest) -> int:
    (data,) = cycle.ask(request.frames, request.answers, request.is_answered_by).values()
    if len(data) != SDO_BYTES:
        raise LineFault(DeviceFlag.GARBAGE, "an answer of the node has not eight bytes")
    if data[0] == _ABORT:
        place = request.place
        which = f"0x{place[1]:02X}{place[0]:02X}:{place[2]}"
        code = int.from_bytes(data[4:], "little")
        what = f"object {which} cannot be read: abort code 0x{code:08X}"
        raise LineFault(DeviceFlag.WRONG_REQUEST, what)
    if data[0] != _ANSWER:
        raise LineFault(DeviceFlag.GARBAGE, "the node's answer is none of two bytes")
    return data[4] | data[5] << 8
