"""Messages of the APT protocol as bytes; every function is pure and may be called in the loop.

A short message is a header of 6 bytes: what it is, two parameters, to whom, from whom. A long one
has the number of bytes that follow in place of the parameters, and the top bit of the address set.
Numbers are little-endian. There is no checksum: a header is told from garbage by its addresses, its
length and, where it is known, what it is; a flipped bit in the data cannot be told.
"""

from enum import IntEnum
from struct import Struct
from typing import Final, NamedTuple

HOST: Final = 0x01
UNIT: Final = 0x50
"""A device with a USB port of its own."""

FULL_SCALE: Final = 32767
"""Counts of 100 % of voltage, and of travel."""
MOST_DATA: Final = 255
"""No message has more data."""

_HEADER: Final = Struct("<HBBBB")
_LONG_HEADER: Final = Struct("<HHBB")
MOST_BYTES: Final = _HEADER.size + MOST_DATA
"""No message is longer."""
_WORDS: Final = {n: Struct("<H" + n * "h") for n in (1, 2)}
_STATUS: Final = Struct("<HhhL")
_HARDWARE: Final = Struct("<l8sH4B48s12sHHH")
_RICH_BYTES: Final = 68
"""What it is about, a code and a text."""
_LONG: Final = 0x80
_HOSTS: Final = frozenset({0x00, HOST})
_UNITS: Final = frozenset({0x00, 0x11, *range(0x21, 0x2B), UNIT})


class AptFrameError(ValueError):
    """Raised where bytes are not the message that they are taken for."""


class Id(IntEnum):
    """What a message is: a set, a request, or what answers the request."""

    START_UPDATES = 0x0011
    STOP_UPDATES = 0x0012
    NO_FLASH_PROGRAMMING = 0x0018
    REQ_INFO = 0x0005
    GET_INFO = 0x0006
    RESPONSE = 0x0080
    RICH_RESPONSE = 0x0081
    SET_ENABLED = 0x0210
    REQ_ENABLED = 0x0211
    GET_ENABLED = 0x0212
    SET_CONTROL_MODE = 0x0640
    REQ_CONTROL_MODE = 0x0641
    GET_CONTROL_MODE = 0x0642
    SET_OUTPUT = 0x0643
    REQ_OUTPUT = 0x0644
    GET_OUTPUT = 0x0645
    REQ_MAX_TRAVEL = 0x0650
    GET_MAX_TRAVEL = 0x0651
    SET_SOURCE = 0x0652
    REQ_SOURCE = 0x0653
    GET_SOURCE = 0x0654
    REQ_STATUS = 0x0660
    GET_STATUS = 0x0661
    ACK_STATUS = 0x0662
    REQ_IO = 0x07D5
    GET_IO = 0x07D6
    READING_7DD = 0x07DD
    READING_7DE = 0x07DE
    READING_7DF = 0x07DF


_DATA_BYTES: Final[dict[int, int]] = {
    Id.GET_INFO: _HARDWARE.size,
    Id.RESPONSE: 0,
    Id.RICH_RESPONSE: _RICH_BYTES,
    Id.GET_ENABLED: 0,
    Id.GET_CONTROL_MODE: 0,
    Id.GET_OUTPUT: 4,
    Id.GET_MAX_TRAVEL: 4,
    Id.GET_SOURCE: 4,
    Id.GET_STATUS: _STATUS.size,
    Id.GET_IO: 10,
    Id.READING_7DE: 6,
    Id.READING_7DF: 6,
}
"""How much data the messages to the host have; those that are not listed may have any."""


class Hardware(NamedTuple):
    """Who a device says it is."""

    serial: int
    model: str
    firmware: str


class CubeStatus(NamedTuple):
    """What a piezo amplifier tells of itself.

    Attributes:
        output: Voltage in counts, `FULL_SCALE` for the highest.
        position: Of a strain gauge that belongs to it, in counts.
        bits: What is the matter, as `StatusBit`.
    """

    output: int
    position: int
    bits: int


class StatusBit(IntEnum):
    """Bits of a status."""

    CLOSED_LOOP = 0x400
    ENABLED = 0x80000000


def short(ident: int, p1: int = 0, p2: int = 0, to: int = UNIT, source: int = HOST) -> bytes:
    """Return a message without data."""
    return _HEADER.pack(ident, p1, p2, to, source)


def long(ident: int, data: bytes, to: int = UNIT, source: int = HOST) -> bytes:
    """Return a message with data."""
    return _LONG_HEADER.pack(ident, len(data), to | _LONG, source) + data


def words(channel: int, *values: int) -> bytes:
    """Return a channel and one or two signed numbers as data."""
    return _WORDS[len(values)].pack(channel, *values)


def ident_of(frame: bytes) -> int:
    """Tell what a message of at least two bytes is."""
    return frame[0] | frame[1] << 8


def length_to_host(got: bytes) -> int:
    """Find the first message to the host, as a `LengthOf`."""
    length = _length(got, _HOSTS, _UNITS)
    if length >= 0 and len(got) >= _HEADER.size:
        wanted = _DATA_BYTES.get(got[0] | got[1] << 8)
        if wanted is not None and _data_bytes(got) != wanted:
            return -1
    return length


def length_of_whole(got: bytes) -> int:
    """Tell the length of the first of several messages that are whole, as a `LengthOf`."""
    return _HEADER.size + _data_bytes(got) if got else 0


def length_to_unit(got: bytes) -> int:
    """Find the first message to a device, as a `LengthOf`."""
    return _length(got, _UNITS, _HOSTS)


def short_of(frame: bytes) -> tuple[int, int]:
    """Return the parameters of a message without data.

    Raises:
        AptFrameError: If it has data, or is too short.
    """
    if len(frame) != _HEADER.size or frame[4] & _LONG:
        raise AptFrameError(f"no short message: {frame.hex()}")
    return frame[2], frame[3]


def words_of(frame: bytes, channel: int, n: int = 1) -> tuple[int, ...]:
    """Return the first signed numbers of a message that begins with a channel.

    Raises:
        AptFrameError: If there are not as many, or they are another channel's.
    """
    data = frame[_HEADER.size :]
    if len(data) < _WORDS[n].size:
        raise AptFrameError(f"too short: {frame.hex()}")
    told, *values = _WORDS[n].unpack_from(data)
    if told != channel:
        raise AptFrameError(f"of channel {told}, not {channel}")
    return tuple(values)


def status_of(frame: bytes) -> CubeStatus:
    """Return the status in a message.

    Raises:
        AptFrameError: If it holds none.
    """
    if len(frame) != _HEADER.size + _STATUS.size:
        raise AptFrameError(f"no status: {frame.hex()}")
    _, *values = _STATUS.unpack_from(frame, _HEADER.size)
    return CubeStatus(*values)


def pack_status(channel: int, status: CubeStatus) -> bytes:
    """Return a status as data."""
    return _STATUS.pack(channel, *status)


def hardware_of(frame: bytes) -> Hardware:
    """Return who a device says it is.

    Raises:
        AptFrameError: If the message does not tell.
    """
    if len(frame) != _HEADER.size + _HARDWARE.size:
        raise AptFrameError(f"no identity: {frame.hex()}")
    fields = _HARDWARE.unpack_from(frame, _HEADER.size)
    minor, interim, major = fields[3], fields[4], fields[5]
    return Hardware(fields[0], _text(fields[1]), f"{major}.{interim}.{minor}")


def pack_hardware(hardware: Hardware) -> bytes:
    """Return an identity as data."""
    major, interim, minor = map(int, hardware.firmware.split("."))
    model = hardware.model.encode("ascii")
    serial = hardware.serial
    return _HARDWARE.pack(serial, model, 44, minor, interim, major, 0, b"", b"", 1, 0, 1)


def _text(raw: bytes) -> str:
    return raw.split(b"\0", 1)[0].decode("ascii", "replace").strip()


def _data_bytes(got: bytes) -> int:
    return got[2] | got[3] << 8 if got[4] & _LONG else 0


def _length(got: bytes, receivers: frozenset[int], senders: frozenset[int]) -> int:
    if len(got) < _HEADER.size:
        return -1 if len(got) == 5 and got[4] & ~_LONG not in receivers else 0
    data = _data_bytes(got)
    if got[4] & ~_LONG not in receivers or got[5] not in senders or data > MOST_DATA:
        return -1
    length = _HEADER.size + data
    return length if len(got) >= length else 0
