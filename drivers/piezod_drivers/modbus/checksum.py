"""The checksum of Modbus RTU, two bytes at a step."""

from functools import lru_cache
from struct import unpack

from pymodbus.framer import FramerRTU


@lru_cache(maxsize=1)
def _of_words() -> list[int]:
    """Return what a word, on top of the checksum so far, makes of it.

    The checksum is linear: a table for 16 bits follows from 16 entries, each for one bit.
    """
    bytewise = FramerRTU.crc16_table
    table = [0]
    for bit in range(16):
        word = 1 << bit
        low = (word >> 8) ^ bytewise[word & 0xFF]
        entry = (low >> 8) ^ bytewise[low & 0xFF]
        table += [entry ^ other for other in table]
    return table


def checksum(data: bytes) -> bytes:
    """Return the two bytes that follow these in a frame; may be called in the loop."""
    table, crc = _of_words(), 0xFFFF
    n_words = len(data) // 2
    for word in unpack(f"<{n_words}H", data[: 2 * n_words]):
        crc = table[crc ^ word]
    if len(data) % 2:
        crc = (crc >> 8) ^ FramerRTU.crc16_table[(crc ^ data[-1]) & 0xFF]
    return crc.to_bytes(2, "little")


@lru_cache(maxsize=64)
def framed(message: bytes) -> bytes:
    """Return a message with its checksum; may be called in the loop, which repeats most of them."""
    return message + checksum(message)


def is_whole(frame: bytes) -> bool:
    """Tell whether a frame ends in its checksum; may be called in the loop."""
    return len(frame) > 2 and checksum(frame[:-2]) == frame[-2:]
