"""Requests and replies of a player board as bytes. Every function is pure. Real-time safe.

A request is a line, `@TAG WORDS*CRC`; the reply repeats the tag. Binary data have a CRC of their
own.
"""

from binascii import crc_hqx
from collections.abc import Callable, Sequence
from struct import Struct, pack
from typing import Final, NamedTuple

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag

CODES: Final = 65_535
"""Code of the highest voltage of a converter."""
LINES: Final = 3
"""Lines of pulses: point, line and frame, in this order."""
TAGS: Final = 0x1000
"""Number of different tags."""
ROWS: Final = 128
"""Most rows of a table or a record in an exchange."""
_CRC_BEGIN: Final = 0xFFFF
_CRC: Final = Struct("<H")
_MOST_LINE: Final = 300


class BoardStatus(NamedTuple):
    """What a board reports."""

    state: str  #: "off", "on" or "play".
    flags: str  #: Letters: r reset, w watchdog, l late, o bytes lost; "-" for none.
    outputs: tuple[int, ...]  #: Code of each output in force.
    inputs: tuple[int, ...]  #: Code of each input.
    cycle: int  #: Complete cycles of the play.
    kept: int  #: Recorded rows.


def crc_of(data: bytes) -> int:
    """Return CRC-16/CCITT-FALSE."""
    return crc_hqx(data, _CRC_BEGIN)


def request(number: int, words: str) -> bytes:
    """Return the line of a request.

    Args:
        number: Number of the exchange, below `TAGS`.
        words: The request.
    """
    line = f"@{number:03x} {words}".encode("ascii")
    return b"%b*%04X\n" % (line, crc_of(line))


def tag_of(number: int) -> bytes:
    """Return what a reply begins with."""
    return b"@%03x " % number


def reply_length(tag: bytes, n_data: int = 0) -> Callable[[bytes], int]:
    """Return the function that finds the reply to a request, as `LengthOf`.

    Args:
        tag: What it begins with.
        n_data: Bytes behind the line, if it is not an error.
    """

    def length(got: bytes) -> int:
        begin = got.find(tag)
        if begin > 0:
            return -begin
        end = got.find(b"\n")
        if end < 0:
            return -len(got) if len(got) > _MOST_LINE else 0
        if begin < 0:
            return -end - 1
        if not _is_checked(got[:end]):
            raise LineFault(DeviceFlag.BAD_CHECKSUM, "a reply of the board has a wrong checksum")
        whole = end + 1 + (0 if got.startswith(tag + b"E ") else n_data)
        return whole if len(got) >= whole else 0

    return length


def words_of(frame: bytes, tag: bytes) -> str:
    """Return the words of a reply that `reply_length` has found."""
    return frame[len(tag) : frame.index(b"\n") - 5].decode("ascii", "replace")


def status_of(words: str, channels: int) -> BoardStatus:
    """Return the status in the words of a reply.

    Raises:
        LineFault: If there is none.
    """
    parts = words.split(" ")
    if len(parts) != 5 + 2 * channels or parts[0] != "S" or not _are_numbers(parts[3:]):
        raise LineFault(DeviceFlag.GARBAGE, f"{words!r} is no status of {channels} channels")
    numbers = tuple(map(int, parts[3:]))
    outputs, inputs = numbers[:channels], numbers[channels : 2 * channels]
    return BoardStatus(parts[1], parts[2], outputs, inputs, numbers[-2], numbers[-1])


def numbers_of(words: str, begin: str, n: int) -> list[int]:
    """Return the numbers behind the first word of a reply.

    Raises:
        LineFault: If it begins with another word, or has something else.
    """
    first, *parts = words.split(" ")
    if first != begin or len(parts) != n or not _are_numbers(parts):
        raise LineFault(DeviceFlag.GARBAGE, f"{words!r} is not {begin} with {n} numbers")
    return list(map(int, parts))


def data_bytes(values: Sequence[int]) -> bytes:
    """Return values as a table has them, without the CRC."""
    return pack(f"<{len(values)}H", *values)


def with_crc(data: bytes) -> bytes:
    """Return data with their CRC."""
    return data + _CRC.pack(crc_of(data))


def data_of(frame: bytes) -> tuple[int, ...]:
    """Return the values behind the line of a reply.

    Raises:
        LineFault: If their CRC is wrong.
    """
    data = frame[frame.index(b"\n") + 1 :]
    if _CRC.pack(crc_of(data[:-2])) != data[-2:]:
        raise LineFault(DeviceFlag.BAD_CHECKSUM, "data of the board have a wrong checksum")
    return Struct(f"<{len(data) // 2 - 1}H").unpack(data[:-2])


def _is_checked(line: bytes) -> bool:
    text, star, crc = line[:-5], line[-5:-4], line[-4:]
    return star == b"*" and crc == b"%04X" % crc_of(text)


def _are_numbers(parts: Sequence[str]) -> bool:
    return all(part.isascii() and part.isdigit() and len(part) <= 10 for part in parts)
