"""Reads single channels by SDO in the loop."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.conversation import CanConversation
from piezod_drivers.can_bus.frame import Frame

SDO_BYTES: Final = 8
# Command bytes of SDO (CiA 301).
_READ: Final = 0x40  # request: upload an object
_NEXT: Final = 0x60  # request: the first segment of it
_ABORT: Final = 0x80
_REPLY: Final = 0xE0
_REPLY_UPLOAD: Final = 0x40
_EXPEDITED: Final = 0x02  # the bytes are in this frame
_SIZED: Final = 0x01  # the reply has their number
_ONE_WORD: Final = 2 << 2 | _EXPEDITED | _SIZED  # two of four bytes are unused
_LAST: Final = 0x01


class SdoReadRequest(NamedTuple):
    """A request for the word of a channel."""

    frames: tuple[Frame]  #: The request.
    address: bytes  #: Index and sub-index of the object; the reply repeats them.
    answers: frozenset[int]  #: Identifier of the reply.
    #: The request for the first segment, for a node that sends the word in segments.
    next: tuple[Frame]

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
    segment = Frame(objects.SDO_REQUEST + node, bytes((_NEXT, *bytes(7))))
    requests = []
    for number in numbers:
        address = bytes((*index.to_bytes(2, "little"), number))
        frame = Frame(objects.SDO_REQUEST + node, bytes((_READ, *address, 0, 0, 0, 0)))
        requests.append(SdoReadRequest((frame,), address, answers, (segment,)))
    return requests


def read_words(cycle: CanConversation, requests: Sequence[SdoReadRequest]) -> list[int]:
    """Read the 16-bit word of each channel, one after the other. Real-time safe.

    Raises:
        LineFault: If the node does not reply in time, refuses, or sends an invalid reply, or if the
            bus fails.
    """
    return [_read_word(cycle, request) for request in requests]


def _read_word(cycle: CanConversation, request: SdoReadRequest) -> int:
    data = _ask(cycle, request, request.frames, request.is_answered_by)
    head = data[0] & ~_REPLY
    if data[0] & _REPLY == _REPLY_UPLOAD:
        if head in {_ONE_WORD, _EXPEDITED}:  # without a size, that of the object holds
            return data[4] | data[5] << 8
        if not head & _EXPEDITED:
            n_bytes = int.from_bytes(data[4:], "little") if head & _SIZED else objects.WORD_BYTES
            if n_bytes == objects.WORD_BYTES:
                return _read_segment(cycle, request)
    what = f"the node's reply for object {_name_of(request)} does not carry two bytes"
    raise LineFault(DeviceFlag.GARBAGE, f"{what}: {data.hex(' ')}")


def _read_segment(cycle: CanConversation, request: SdoReadRequest) -> int:
    """Read a word that the node sends in a segment of its own."""
    data = _ask(cycle, request, request.next, _is_segment)
    # The size may be left out, which looks like seven bytes.
    n_bytes = objects.SEGMENT_BYTES - (data[0] >> 1 & 7)
    if not data[0] & _LAST or n_bytes not in {objects.WORD_BYTES, objects.SEGMENT_BYTES}:
        what = f"the node's segment for object {_name_of(request)} does not carry two bytes"
        raise LineFault(DeviceFlag.GARBAGE, f"{what}: {data.hex(' ')}")
    return data[1] | data[2] << 8


def _ask(
    cycle: CanConversation,
    request: SdoReadRequest,
    frames: tuple[Frame],
    check: Callable[[Frame], bool],
) -> bytes:
    (data,) = cycle.ask(frames, request.answers, check).values()
    if len(data) != SDO_BYTES:
        raise LineFault(DeviceFlag.GARBAGE, "an SDO reply of the node does not have eight bytes")
    if data[0] == _ABORT:
        code = int.from_bytes(data[4:], "little")
        what = f"the node refuses to read object {_name_of(request)}: abort code 0x{code:08X}"
        raise LineFault(DeviceFlag.WRONG_REQUEST, what)
    return data


def _is_segment(frame: Frame) -> bool:
    """Return whether a frame can be a first segment, or a refusal."""
    return frame.is_plain and frame.data[:1] != b"" and frame.data[0] & _REPLY in {0, _ABORT}


def _name_of(request: SdoReadRequest) -> str:
    low, high, number = request.address
    return f"0x{high:02X}{low:02X}:{number}"
