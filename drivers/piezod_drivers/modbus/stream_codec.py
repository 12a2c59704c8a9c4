"""The packets of a LabJack's stream, and the voltages in them. Pure."""

from struct import Struct
from typing import Final, NamedTuple

from piezod_drivers.modbus.codec import FEEDBACK
from piezod_drivers.modbus.profiles.labjack_stream import InputScale

HEADER: Final = Struct(">HHHBBBBHHH")
"""Number, protocol, bytes that follow, unit, function, type, reserved, backlog, status, extra."""
_BEFORE: Final = 6
"""Bytes of the header that its length does not count."""
_TYPE: Final = 16


class Packet(NamedTuple):
    """A packet of a stream."""

    number: int  #: Its number, which counts from 0 and wraps.
    status: int  #: Status of the stream.
    extra: int  #: What belongs to the status, such as a number of lost scans.
    samples: bytes  #: Its samples, 2 bytes each.


def take_packet(data: bytes) -> tuple[Packet | None, bytes]:
    """Return the first packet of the received bytes, None if it is incomplete, and the rest.

    Real-time safe.

    Raises:
        ValueError: If the bytes are no packet.
    """
    if len(data) < HEADER.size:
        return None, data
    number, protocol, length, _, function, kind, _, _, status, extra = HEADER.unpack_from(data)
    end = length + _BEFORE
    if protocol or function != FEEDBACK or kind != _TYPE or end < HEADER.size or end % 2:
        raise ValueError(f"not a packet of a stream: {data[: HEADER.size].hex(' ')}")
    if len(data) < end:
        return None, data
    return Packet(number, status, extra, data[HEADER.size : end]), data[end:]


def volts(code: int, scale: InputScale) -> float:
    """Return the voltage of one code, in V. Real-time safe."""
    center, above, below, offset = scale
    return offset + (code - center) * (above if code >= center else below)
