"""Checksums in frames; a DBC file names their signal, but not their algorithm."""

from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import Final, Literal, TypeAlias

Algorithm: TypeAlias = Literal["crc8_j1850", "xor", "sum"]

# x⁸ + x⁴ + x³ + x² + 1, without its highest term.
_POLYNOMIAL: Final = 0x1D


def _entry(value: int) -> int:
    for _ in range(8):
        value = value << 1 ^ _POLYNOMIAL if value & 0x80 else value << 1
    return value & 0xFF


_TABLE: Final = tuple(_entry(value) for value in range(256))


def crc8_j1850(data: bytes | bytearray) -> int:
    """Return the CRC-8 of SAE J1850. Real-time safe."""
    # SAE J1850: start value 0xFF, and the result inverted.
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
"""Each maps the bytes of a frame, without the checksum itself, to a byte."""
