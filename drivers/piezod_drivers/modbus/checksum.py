"""The checksum of Modbus RTU (CRC-16), computed two bytes at a time."""

from functools import lru_cache
from struct import unpack

from pymodbus.framer import FramerRTU


@lru_cache(maxsize=1)
def _of_words() -> list[int]:
    """Return the table that updates the checksum with one 16-bit word.

    The checksum is linear over XOR: 16 entries, one for each bit, give the table for all words.
    """
    # pymodbus has the table for single bytes; two steps of it are one step with a word.
    bytewise = FramerRTU.crc16_table
    table = [0]
    for bit in range(16):
        word = 1 << bit
        low = (word >> 8) ^ bytewise[word & 0xFF]
        entry = (low >> 8) ^ bytewise[low & 0xFF]
        table += [entry ^ other for other in table]
    return table


def checksum(data: bytes) -> bytes:
    """Return the checksum of data, two bytes. Real-time safe."""
    table, crc = _of_words(), 0xFFFF
    n_words = len(data) // 2
    for word in unpack(f"<{n_words}H", data[: 2 * n_words]):
        # The checksum is reflected (lowest bit first), so words are read with the low byte first.
        crc = table[crc ^ word]
    if len(data) % 2:
        crc = (crc >> 8) ^ FramerRTU.crc16_table[(crc ^ data[-1]) & 0xFF]
    return crc.to_bytes(2, "little")


@lru_cache(maxsize=64)  # the loop repeats most of its messages
def with_checksum(message: bytes) -> bytes:
    """Return a message with its checksum. Real-time safe."""
    return message + checksum(message)


def has_valid_checksum(frame: bytes) -> bool:
    """Return whether a frame ends with its checksum. Real-time safe."""
    return len(frame) > 2 and checksum(frame[:-2]) == frame[-2:]
