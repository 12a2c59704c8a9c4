"""Reads single channels by SDO in the loop."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.conversation import CanConversation
from piezod_drivers.can_bus.frame import Frame

SDO_BYTES: Final = 8
# Command bytes of SDO (CiA 301).
_READ: Final = 0x40  # request: upload an object
_ANSWER: Final = 0x4B  # reply: two bytes of it, in this frame
_ABORT: Final = 0x80


class SdoReadRequest(NamedTuple):
    """A request for the word of a channel.

    Attributes:
        frames: The request.
        address: Index and sub-index of the object; the reply repeats them.
        answers: Identifier of the reply.
    """

    frames: tuple[Frame]
    address: bytes
    answers: frozenset[int]

    def is_answered_by(self, frame: Frame) -> bool:
        """Return whether a frame with the reply's identifier has this object."""
        return frame.data[1:4] == self.address and frame.is_plain


def read_requests(node: int, index: int, numbers: Sequence[int]) -> list[SdoReadRequest]:
    """Return the requests for the words of channels.

    Args:
        node: Node number.
        index: Index of the object that has the words.
        numbers: Sub-index of each channel.
    """
    answers = frozenset({objects.SDO_ANSWER + node})
    requests = []
    for number in numbers:
        address = bytes((*index.to_bytes(2, "little"), number))
        frame = Frame(objects.SDO_REQUEST + node, bytes((_READ, *address, 0, 0, 0, 0)))
        requests.append(SdoReadRequest((frame,), address, answers))
    return requests


def read_words(cycle: CanConversation, requests: Sequence[SdoReadRequest]) -> list[int]:
    """Read the 16-bit word of each channel, one after the other. Real-time safe.

    Raises:
        LineFault: If the node does not reply in time, refuses, or sends an invalid reply, or if the
            bus fails.
    """
    return [_read_word(cycle, request) for request in requests]


def _read_word(cycle: CanConversation, request: SdoReadRequest) -> int:
    (data,) = cycle.ask(request.frames, request.answers, request.is_answered_by).values()
    if len(data) != SDO_BYTES:
        raise LineFault(DeviceFlag.GARBAGE, "an SDO reply of the node does not have eight bytes")
    if data[0] == _ABORT:
        address = request.address
        which = f"0x{address[1]:02X}{address[0]:02X}:{address[2]}"
        code = int.from_bytes(data[4:], "little")
        what = f"the node refuses to read object {which}: abort code 0x{code:08X}"
        raise LineFault(DeviceFlag.WRONG_REQUEST, what)
    # Only an expedited reply of two bytes has this command byte, and analogue objects have 16 bits.
    if data[0] != _ANSWER:
        raise LineFault(DeviceFlag.GARBAGE, "an SDO reply of the node does not carry two bytes")
    return data[4] | data[5] << 8
