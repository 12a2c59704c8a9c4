"""Frames of an LC.400 as bytes. Every function is pure. Real-time safe.

A frame begins with a command and ends with 0x55; between them are an address and 32-bit words, all
little-endian. There is no checksum and no escape sequence: a frame is recognized by its command,
its address, its end and its length. A flipped bit in a word cannot be detected.

A reply repeats the address that was read. Therefore each exchange also reads one address in the
memory of the wavetable that changes from exchange to exchange. Its reply serves as the tag of all
replies of the exchange.
"""

import re
from collections.abc import Callable, Sequence
from enum import IntEnum
from struct import Struct
from typing import Final

FULL_SCALE: Final = 1_048_574
"""Counts of the whole range, and of 100 % of the command: from -524287 to 524287."""
HALF_SCALE: Final = FULL_SCALE // 2
FIRMWARE: Final = 0x11830028
FIRMWARE_WORDS: Final = 5
TAGS: Final = 0x4000
"""Number of different tags."""
CLOCK_NS: Final = 24_000
"""Time of a clock cycle of the controller, in ns."""
WAVE_POINTS: Final = 83_333
"""Points of the wavetable of a channel, and samples of a buffer of the recorder."""
RECORD_BUFFERS: Final = 8
RECORD_COUNT: Final = 0x1183036C
RECORD_START: Final = 0x11830374
RECORD_DIVISOR: Final = 0x118300F4
"""Clock cycles for each sample."""
MOST_WORDS: Final = 83_300

_READ, _WRITE, _WRITE_NEXT, _READ_ARRAY, _END = 0xA0, 0xA2, 0xA3, 0xA4, 0x55
_CHANNEL_0: Final = 0x11830000
_CHANNEL_STEP: Final = 0x1000
_WAVETABLE: Final = 0xC0000000
_RECORD_POINTER: Final = 0x1183037C
_RECORD_BUFFER: Final = 0xC03F0000
_TABLE_STEP: Final = 0x54000
# The two high bytes of the tag's address, which are the same in every exchange.
_TAG_END: Final = (_WAVETABLE >> 16).to_bytes(2, "little")
_REQUEST: Final = Struct("<BIB")
_WORD: Final = Struct("<BIiB")
_NEXT: Final = Struct("<BiB")
_ARRAY_REQUEST: Final = Struct("<BIIB")
_INT, _FLOAT = Struct("<i"), Struct("<f")
_REPLY_BYTES: Final = _WORD.size


class Lc400FrameError(ValueError):
    """Raised if bytes are not the expected frame."""


class Lc400Register(IntEnum):
    """Registers of a channel, by their offset."""

    RANGE_TYPE = 0x044
    RANGE = 0x078
    SERVO = 0x084
    WAVE_ENABLE = 0x1F4
    WAVE_INDEX = 0x1F8
    WAVE_DELAY = 0x200
    """Clock cycles to wait before the next point."""
    WAVE_LAST = 0x204
    WAVE_ACTIVE = 0x208
    SETPOINT = 0x218
    INVERSE_SCALE = 0x230
    """Float: the loop input times this is the command."""
    POSITION = 0x334
    LOOP_INPUT = 0x404


def register_address(channel: int, register: int) -> int:
    """Return the address of a channel's register; channels are counted from 1."""
    return _CHANNEL_0 + channel * _CHANNEL_STEP + register


def wave_address(channel: int) -> int:
    """Return the address of the first point of a channel's wavetable."""
    return _WAVETABLE + (channel - 1) * _TABLE_STEP


def record_pointer(buffer: int) -> int:
    """Return where the address is written that a buffer records; buffers are counted from 0."""
    return _RECORD_POINTER + 4 * buffer


def record_buffer(buffer: int) -> int:
    """Return the address of the first sample of a buffer."""
    return _RECORD_BUFFER + buffer * _TABLE_STEP


def tag_address(number: int) -> int:
    """Return the address that is read as the tag of an exchange."""
    return _WAVETABLE + 4 * (number % TAGS)


def read(address: int) -> bytes:
    """Return the request for a word."""
    return _REQUEST.pack(_READ, address, _END)


def write(address: int, value: int) -> bytes:
    """Return the request that writes a word; it has no reply."""
    return _WORD.pack(_WRITE, address, value, _END)


def write_array(address: int, values: Sequence[int]) -> bytes:
    """Return the request that writes words one after the other; it has no reply."""
    following = (_NEXT.pack(_WRITE_NEXT, value, _END) for value in values[1:])
    return write(address, values[0]) + b"".join(following)


def read_array(address: int, n: int) -> bytes:
    """Return the request for n words."""
    return _ARRAY_REQUEST.pack(_READ_ARRAY, address, n, _END)


def read_reply(address: int, value: int) -> bytes:
    """Return the reply to `read`."""
    return _WORD.pack(_READ, address, value, _END)


def array_reply(address: int, words: Sequence[int]) -> bytes:
    """Return the reply to `read_array`."""
    data = b"".join(word.to_bytes(4, "little", signed=True) for word in words)
    return bytes((_READ_ARRAY,)) + address.to_bytes(4, "little") + data + bytes((_END,))


class Poll:
    """The addresses that an exchange reads in addition to its tag."""

    def __init__(self, addresses: Sequence[int]) -> None:
        self._requests = b"".join(map(read, addresses))
        begin, end = bytes((_READ,)), bytes((_END,))
        # Bytes that are the same in every exchange, with their positions: they reveal garbage
        # before the replies are complete. The two low bytes of the tag's address change.
        fixed = [(0, begin), (3, _TAG_END), (_REPLY_BYTES - 1, end)]
        for i, address in enumerate(addresses, 1):
            fixed.append((i * _REPLY_BYTES, begin + address.to_bytes(4, "little")))
            fixed.append(((i + 1) * _REPLY_BYTES - 1, end))
        self._fixed, self._length = fixed, _REPLY_BYTES * (len(addresses) + 1)
        bodies = (re.escape(begin + one.to_bytes(4, "little")) + b".{4}U" for one in addresses)
        whole = re.escape(begin) + b".." + re.escape(_TAG_END) + b".{4}U" + b"".join(bodies)
        self._whole = re.compile(whole, re.DOTALL)
        # Skips command, address and end of each reply.
        self._values = Struct(f"<{_REPLY_BYTES}x" + "5xix" * len(addresses))

    def request(self, number: int) -> bytes:
        """Return the request of the exchange with this number."""
        return read(tag_address(number)) + self._requests

    def length_of(self, got: bytes) -> int:
        """Return the length of the replies of an exchange with any number, as a `LengthOf`."""
        # Nearly always all replies have come at once: one match instead of many comparisons.
        if self._whole.match(got):
            return self._length
        for place, wanted in self._fixed:
            # Compared as far as bytes have come.
            there = got[place : place + len(wanted)]
            if there != wanted[: len(there)]:
                return _garbage(got, _READ)
        return 0

    def values(self, frame: bytes) -> tuple[int, ...]:
        """Return the words that were read.

        Raises:
            Lc400FrameError: If these are not the replies.
        """
        if len(frame) != self._length:
            raise Lc400FrameError(f"not the replies: {frame.hex()}")
        return self._values.unpack(frame)


def has_tag(frame: bytes, number: int) -> bool:
    """Return whether replies belong to the exchange with this number."""
    return frame[1:5] == tag_address(number).to_bytes(4, "little")


def array_length(address: int, n: int) -> Callable[[bytes], int]:
    """Return a `LengthOf` for the reply to `read_array`."""
    begin = bytes((_READ_ARRAY,)) + address.to_bytes(4, "little")
    length = len(begin) + 4 * n + 1

    def length_of(got: bytes) -> int:
        if got[: len(begin)] != begin[: len(got)]:
            return _garbage(got, _READ_ARRAY)
        if len(got) < length:
            return 0
        return length if got[length - 1] == _END else _garbage(got, _READ_ARRAY)

    return length_of


def _garbage(got: bytes, start: int) -> int:
    """Return the negative number of bytes before the next possible start of a frame."""
    place = got.find(start, 1)
    return -len(got) if place < 0 else -place


def array_words(frame: bytes) -> tuple[int, ...]:
    """Return the words of a reply to `read_array`.

    Raises:
        Lc400FrameError: If it is not such a reply.
    """
    if len(frame) < 6 or len(frame) % 4 != 2:
        raise Lc400FrameError(f"not a reply with words: {frame.hex()}")
    return tuple(word for (word,) in _INT.iter_unpack(frame[5:-1]))


def float_of(word: int) -> float:
    """Return the float whose bytes a word has."""
    (value,) = _FLOAT.unpack(_INT.pack(word))
    return float(value)


def text_of(frame: bytes) -> str:
    """Return the printable characters of the words of an array."""
    return "".join(chr(code) for code in frame[5:-1] if 32 <= code < 127).strip()


_REQUEST_SIZES: Final = {
    _READ: _REQUEST.size,
    _WRITE: _WORD.size,
    _WRITE_NEXT: _NEXT.size,
    _READ_ARRAY: _ARRAY_REQUEST.size,
}


def request_length(got: bytes) -> int:
    """Return the length of the first frame to a controller, as a `LengthOf`."""
    if not got:
        return 0
    length = _REQUEST_SIZES.get(got[0])
    if length is None:
        return -1
    if len(got) < length:
        return 0
    return length if got[length - 1] == _END else -1


class Lc400Request(IntEnum):
    """Kinds of frames to a controller."""

    READ = _READ
    WRITE = _WRITE
    WRITE_NEXT = _WRITE_NEXT
    READ_ARRAY = _READ_ARRAY


def parse_request(frame: bytes) -> tuple[Lc400Request, int, int]:
    """Return kind, address, and value or number of words of a frame to a controller.

    Raises:
        Lc400FrameError: If it is not a request.
    """
    if request_length(frame) != len(frame) or not frame:
        raise Lc400FrameError(f"not a request: {frame.hex()}")
    request = Lc400Request(frame[0])
    if request is Lc400Request.READ:
        return request, _REQUEST.unpack(frame)[1], 0
    if request is Lc400Request.WRITE_NEXT:
        return request, 0, _NEXT.unpack(frame)[1]
    _, address, value, _ = (_WORD if request is Lc400Request.WRITE else _ARRAY_REQUEST).unpack(
        frame
    )
    return request, address, value
