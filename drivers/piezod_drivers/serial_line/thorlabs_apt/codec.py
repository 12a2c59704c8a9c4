"""Messages of the APT protocol as bytes. Every function is pure. Real-time safe.

A short message is a header of 6 bytes: identifier, two parameters, receiver, sender. A long message
has the number of data bytes in place of the parameters, and the top bit of the receiver set.
Numbers are little-endian. There is no checksum. A header is distinguished from garbage by its
addresses, its length and, if known, its identifier. A flipped bit in the data cannot be detected.
"""

from enum import IntEnum
from struct import Struct
from typing import Final, NamedTuple

HOST: Final = 0x01
UNIT: Final = 0x50
"""Address of a device with a USB port of its own."""

FULL_SCALE: Final = 32767
"""Counts at 100 % of voltage and of travel."""
MAX_DATA_BYTES: Final = 255
"""No message has more data bytes."""

_HEADER: Final = Struct("<HBBBB")
_LONG_HEADER: Final = Struct("<HHBB")
MAX_MESSAGE_BYTES: Final = _HEADER.size + MAX_DATA_BYTES
"""No message is longer."""
_WORDS: Final = {n: Struct("<H" + n * "h") for n in (1, 2)}
# Channel, analog output to the hub, display mode, force calibration, unused.
_GAUGE_IO: Final = Struct("<HHHH6s")
# Channel, voltage, position, bits.
_STATUS: Final = Struct("<HhhL")
# Serial number, model, type, firmware, notes, unused, hardware version, modification, channels.
_HARDWARE: Final = Struct("<l8sH4B48s12sHHH")
_RICH_BYTES: Final = 68
"""An identifier, a code and a text."""
_LONG: Final = 0x80  # set in the receiver's address of a message with data
# 0x00 is accepted at either end; 0x11 is a rack controller, 0x21 to 0x2A are its bays.
_HOSTS: Final = frozenset({0x00, HOST})
_UNITS: Final = frozenset({0x00, 0x11, *range(0x21, 0x2B), UNIT})


class AptFrameError(ValueError):
    """Raised if bytes are not the expected message."""


class Id(IntEnum):
    """Identifiers of messages: SET messages, requests (REQ), and replies to these (GET)."""

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
    SET_GAUGE_IO = 0x07DA
    REQ_GAUGE_IO = 0x07DB
    GET_GAUGE_IO = 0x07DC
    REQ_READING = 0x07DD
    GET_READING = 0x07DE


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
    Id.GET_GAUGE_IO: 14,
    Id.GET_READING: 6,
}
"""Number of data bytes of messages to the host; messages that are not listed may have any."""


class Hardware(NamedTuple):
    """Identity of a device."""

    serial: int
    model: str
    firmware: str


class CubeStatus(NamedTuple):
    """Status of a piezo amplifier."""

    output: int  #: Voltage in counts, `FULL_SCALE` at the highest voltage.
    position: int  #: Reading of its own strain gauge, in counts.
    bits: int  #: Status bits, see `StatusBit`.


class StatusBit(IntEnum):
    """Bits of a status."""

    CLOSED_LOOP = 0x400
    ENABLED = 0x80000000


class DisplayMode(IntEnum):
    """What a strain gauge reader shows, which is also the quantity of its readings."""

    POSITION = 1
    VOLTAGE = 2
    FORCE = 3


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
    """Return the identifier of a message of at least two bytes."""
    return frame[0] | frame[1] << 8


def length_to_host(got: bytes) -> int:
    """Return the length of the first message to the host, as a `LengthOf`."""
    length = _length(got, _HOSTS, _UNITS)
    if length >= 0 and len(got) >= _HEADER.size:
        # A known message with a wrong length is garbage that looks like a header.
        wanted = _DATA_BYTES.get(got[0] | got[1] << 8)
        if wanted is not None and _data_bytes(got) != wanted:
            return -1
    return length


def length_of_whole(got: bytes) -> int:
    """Return the length of the first of several complete messages, as a `LengthOf`."""
    return _HEADER.size + _data_bytes(got) if got else 0


def length_to_unit(got: bytes) -> int:
    """Return the length of the first message to a device, as a `LengthOf`."""
    return _length(got, _UNITS, _HOSTS)


def short_of(frame: bytes) -> tuple[int, int]:
    """Return the parameters of a message without data.

    Raises:
        AptFrameError: If it has data, or is too short.
    """
    if len(frame) != _HEADER.size or frame[4] & _LONG:
        raise AptFrameError(f"not a short message: {frame.hex()}")
    return frame[2], frame[3]


def words_of(frame: bytes, channel: int, n: int = 1) -> tuple[int, ...]:
    """Return the first signed numbers of a message that begins with a channel.

    Raises:
        AptFrameError: If there are too few, or they belong to another channel.
    """
    data = frame[_HEADER.size :]
    if len(data) < _WORDS[n].size:
        raise AptFrameError(f"too short: {frame.hex()}")
    found, *values = _WORDS[n].unpack_from(data)
    if found != channel:
        raise AptFrameError(f"channel {found} instead of {channel}")
    return tuple(values)


def status_of(frame: bytes) -> CubeStatus:
    """Return the status in a message.

    Raises:
        AptFrameError: If it holds no status.
    """
    if len(frame) != _HEADER.size + _STATUS.size:
        raise AptFrameError(f"not a status: {frame.hex()}")
    _, *values = _STATUS.unpack_from(frame, _HEADER.size)
    return CubeStatus(*values)


def pack_status(channel: int, status: CubeStatus) -> bytes:
    """Return a status as data."""
    return _STATUS.pack(channel, *status)


def display_mode_of(frame: bytes) -> int:
    """Return the display mode in the settings of a strain gauge reader.

    Raises:
        AptFrameError: If it does not hold these settings.
    """
    if len(frame) != _HEADER.size + _GAUGE_IO.size:
        raise AptFrameError(f"not the settings of a strain gauge reader: {frame.hex()}")
    mode: int = _GAUGE_IO.unpack_from(frame, _HEADER.size)[2]
    return mode


def pack_gauge_io(channel: int, display_mode: int) -> bytes:
    """Return the settings of a strain gauge reader as data; the other ones are as delivered."""
    return _GAUGE_IO.pack(channel, 1, display_mode, 30_000, b"")


def hardware_of(frame: bytes) -> Hardware:
    """Return the identity in a message.

    Raises:
        AptFrameError: If it holds no identity.
    """
    if len(frame) != _HEADER.size + _HARDWARE.size:
        raise AptFrameError(f"not an identity: {frame.hex()}")
    fields = _HARDWARE.unpack_from(frame, _HEADER.size)
    # The firmware version is sent with its lowest part first.
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
        # With a wrong receiver no message can start here: skip one byte without waiting for the
        # sixth.
        return -1 if len(got) == 5 and got[4] & ~_LONG not in receivers else 0
    data = _data_bytes(got)
    if got[4] & ~_LONG not in receivers or got[5] not in senders or data > MAX_DATA_BYTES:
        return -1
    length = _HEADER.size + data
    return length if len(got) >= length else 0
