"""Channels read one by one, by SDO, in the loop."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cycle import Cycle
from piezod_drivers.can_bus.frame import Frame

SDO_BYTES: Final = 8
_READ: Final = 0x40
_ANSWER: Final = 0x4B
_ABORT: Final = 0x80
"""SDO: read an object; two bytes of it; there is none."""


def requests_for(node: int, index: int, numbers: Sequence[int]) -> list[Frame]:
    """Return the requests for the words of some channels.

    Args:
        node: Number of the node.
        index: Index of the object that has them.
        numbers: Sub-index of each.
    """
    place = index.to_bytes(2, "little")
    return [
        Frame(objects.SDO_REQUEST + node, bytes((_READ, *place, number, 0, 0, 0, 0)))
        for number in numbers
    ]


def read_words(cycle: Cycle, requests: Sequence[Frame]) -> list[int]:
    """Read the 16 bits of each channel, one after the other; may be called in the loop.

    Raises:
        LineFault: If the node does not answer in time, refuses, or answers something else, or the
            bus fails.
    """
    return [_read_word(cycle, request) for request in requests]


def _read_word(cycle: Cycle, request: Frame) -> int:
    place = request.data[1:4]  # an answer repeats which object it tells
    answer = request.id - objects.SDO_REQUEST + objects.SDO_ANSWER

    def tells_it(frame: Frame) -> bool:
        return frame.is_plain and frame.data[1:4] == place

    data = cycle.ask([request], frozenset({answer}), tells_it)[answer]
    if len(data) != SDO_BYTES:
        raise LineFault(DeviceFlag.GARBAGE, "an answer of the node has not eight bytes")
    if data[0] == _ABORT:
        which = f"0x{place[1]:02X}{place[0]:02X}:{place[2]}"
        code = int.from_bytes(data[4:], "little")
        what = f"object {which} cannot be read: abort code 0x{code:08X}"
        raise LineFault(DeviceFlag.WRONG_REQUEST, what)
    if data[0] != _ANSWER:
        raise LineFault(DeviceFlag.GARBAGE, "the node's answer is none of two bytes")
    return data[4] | data[5] << 8
