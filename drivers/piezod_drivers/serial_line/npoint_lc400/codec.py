"""Frames of an LC.400 as bytes; every function is pure and may be called in the loop.

A frame begins with a command and ends with 0x55; between them are an address and words of 32 bits,
all little-endian. There is no checksum and no escape: a frame is told by its command, its address,
its end and its length, and a flipped bit of a word cannot be told.

A reply repeats the address that was read. So each exchange also reads one address that changes from
exchange to exchange, in the memory of the wavetable: its reply is the tag of all that come with it.
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
"""So many exchanges have different tags."""
MOST_WORDS: Final = 83_300

_READ, _WRITE, _WRITE_NEXT, _READ_ARRAY, _END = 0xA0, 0xA2, 0xA3, 0xA4, 0x55
_CHANNEL_0: Final = 0x11830000
_CHANNEL_STEP: Final = 0x1000
_WAVETABLE: Final = 0xC0000000
_TAG_END: Final = (_WAVETABLE >> 16).to_bytes(2, "little")
_REQUEST: Final = Struct("<BIB")
_WORD: Final = Struct("<BIiB")
_NEXT: Final = Struct("<BiB")
_ARRAY_REQUEST: Final = Struct("<BIIB")
_REPLY_BYTES: Final = _WORD.size


class Lc400FrameError(ValueError):
    """Raised where bytes are not the frame that they are taken for."""


class Lc400Register(IntEnum):
    """Registers of a channel, by their offset."""

    RANGE_TYPE = 0x044
    RANGE = 0x078
    SERVO = 0x084
    SETPOINT = 0x218
    POSITION = 0x334


def address(channel: int, register: int) -> int:
    """Tell where a register of a channel is; channels are counted from 1."""
    return _CHANNEL_0 + channel * _CHANNEL_STEP + register


def tag_address(number: int) -> int:
    """Tell which address is read as the tag of an exchange."""
    return _WAVETABLE + 4 * (number % TAGS)


def read(where: int) -> bytes:
    """Return the request for a word."""
    return _REQUEST.pack(_READ, where, _END)


def write(where: int, value: int) -> bytes:
    """Return the request to write a word, which is not answered."""
    return _WORD.pack(_WRITE, where, value, _END)


def read_array(where: int, n: int) -> bytes:
    """Return the request for n words."""
    return _ARRAY_REQUEST.pack(_READ_ARRAY, where, n, _END)


def reply(where: int, value: int) -> bytes:
    """Return the answer to `read`."""
    return _WORD.pack(_READ, where, value, _END)


def array_reply(where: int, words: Sequence[int]) -> bytes:
    """Return the answer to `read_array`."""
    data = b"".join(word.to_bytes(4, "little", signed=True) for word in words)
    return bytes((_READ_ARRAY,)) + where.to_bytes(4, "little") + data + bytes((_END,))


class Poll:
    """The addresses that an exchange reads beside its tag.

    Args:
        addresses: In their order.
    """

    def __init__(self, addresses: Sequence[int]) -> None:
        self._requests = b"".join(map(read, addresses))
        begin, end = bytes((_READ,)), bytes((_END,))
        fixed = [(0, begin), (3, _TAG_END), (_REPLY_BYTES - 1, end)]
        for i, where in enumerate(addresses, 1):
            fixed.append((i * _REPLY_BYTES, begin + where.to_bytes(4, "little")))
            fixed.append(((i + 1) * _REPLY_BYTES - 1, end))
        self._fixed, self._length = fixed, _REPLY_BYTES * (len(addresses) + 1)
        bodies = (re.escape(begin + one.to_bytes(4, "little")) + b".{4}U" for one in addresses)
        whole = re.escape(begin) + b".." + re.escape(_TAG_END) + b".{4}U" + b"".join(bodies)
        self._whole = re.compile(whole, re.DOTALL)
        self._values = Struct(f"<{_REPLY_BYTES}x" + "5xix" * len(addresses))

    def request(self, number: int) -> bytes:
        """Return what is sent in the exchange of a number."""
        return read(tag_address(number)) + self._requests

    def length_of(self, got: bytes) -> int:
        """Find the replies of an exchange, whatever its number, as a `LengthOf`."""
        if self._whole.match(got):
            return self._length
        for place, wanted in self._fixed:
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
            raise Lc400FrameError(f"no replies: {frame.hex()}")
        return self._values.unpack(frame)


def has_tag(frame: bytes, number: int) -> bool:
    """Tell whether replies are those of an exchange."""
    return frame[1:5] == tag_address(number).to_bytes(4, "little")


def array_length(where: int, n: int) -> Callable[[bytes], int]:
    """Return a `LengthOf` for the answer to `read_array`."""
    begin = bytes((_READ_ARRAY,)) + where.to_bytes(4, "little")
    length = len(begin) + 4 * n + 1

    def length_of(got: bytes) -> int:
        if got[: len(begin)] != begin[: len(got)]:
            return _garbage(got, _READ_ARRAY)
        if len(got) < length:
            return 0
        return length if got[length - 1] == _END else _garbage(got, _READ_ARRAY)

    return length_of


def _garbage(got: bytes, start: int) -> int:
    """Return, negative, how many bytes there are before another one that may begin a frame."""
    place = got.find(start, 1)
    return -len(got) if place < 0 else -place


def text_of(frame: bytes) -> str:
    """Return the words of an array as text: what can be printed of it."""
    return "".join(chr(code) for code in frame[5:-1] if 32 <= code < 127).strip()


def request_length(got: bytes) -> int:
    """Find the first frame to a controller, as a `LengthOf`."""
    if not got:
        return 0
    sizes = {
        _READ: _REQUEST.size,
        _WRITE: _WORD.size,
        _WRITE_NEXT: _NEXT.size,
        _READ_ARRAY: _ARRAY_REQUEST.size,
    }
    length = sizes.get(got[0])
    if length is None:
        return -1
    if len(got) < length:
        return 0
    return length if got[length - 1] == _END else -1


class Lc400Request(IntEnum):
    """What a frame to a controller wants."""

    READ = _READ
    WRITE = _WRITE
    WRITE_NEXT = _WRITE_NEXT
    READ_ARRAY = _READ_ARRAY


def parse_request(frame: bytes) -> tuple[Lc400Request, int, int]:
    """Return what a frame to a controller wants, the address, and the value or number of words.

    Raises:
        Lc400FrameError: If it is none.
    """
    if request_length(frame) != len(frame) or not frame:
        raise Lc400FrameError(f"no request: {frame.hex()}")
    request = Lc400Request(frame[0])
    if request is Lc400Request.READ:
        return request, _REQUEST.unpack(frame)[1], 0
    if request is Lc400Request.WRITE_NEXT:
        return request, 0, _NEXT.unpack(frame)[1]
    _, where, value, _ = (_WORD if request is Lc400Request.WRITE else _ARRAY_REQUEST).unpack(frame)
    return request, where, value
