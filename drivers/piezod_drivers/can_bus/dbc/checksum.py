"""Checksums that frames carry; a DBC file names their signal and not how they are made."""

from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import Final, Literal, TypeAlias

Algorithm: TypeAlias = Literal["crc8_j1850", "xor", "sum"]

_POLYNOMIAL: Final = 0x1D


def _entry(value: int) -> int:
    for _ in range(8):
        value = value << 1 ^ _POLYNOMIAL if value & 0x80 else value << 1
    return value & 0xFF


_TABLE: Final = tuple(_entry(value) for value in range(256))


def crc8_j1850(data: bytes | bytearray) -> int:
    """Return the CRC-8 of SAE J1850; may be called in the loop."""
    value = 0xFF
    for byte in data:
        value = _TABLE[value ^ byte]
    return value ^ 0xFF


def _xor(data: bytes | bytearray) -> int:
    return reduce(xor, data, 0)


def _sum(data: bytes | bytearray) -> int:
    return sum(data) & 0xFF


ALGORITHMS: Final[dict[Algorithm, Callable[[bytes | bytearray], int]]] = {
    "crc8_j1850": crc8_j1850,
    "xor": _xor,
    "sum": _sum,
}
"""Each takes all bytes of a frame but the checksum's own, and gives a byte."""
