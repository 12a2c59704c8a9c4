"""Values of channels as 16-bit codes, and codes as process data."""

from collections.abc import Sequence
from math import nan
from struct import Struct
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag

_HIGHEST_SIGNED: Final = 0x7FFF
_WORDS: Final = 0x1_0000
_MOST_ENTRIES: Final = 8
"""Highest number of mapping entries that is read, whatever the node reports."""
_DATA: Final = tuple(Struct(f"<{n_words}H") for n_words in range(_MOST_ENTRIES + 1))
"""Layout of process data by its number of words."""


class Scale:
    """Converts linearly between the codes of a channel and values in its unit.

    Args:
        codes: Codes at the lowest and at the highest value, from -32768 to 32767 or from 0 to
            65535.
        values: Lowest and highest value, in the unit of the channel.
    """

    def __init__(self, codes: tuple[int, int], values: tuple[float, float]) -> None:
        self._first_code, self._first = codes[0], values[0]
        # `codes` may fall while `values` rise, so the gain may be negative.
        self._gain = (values[1] - values[0]) / (codes[1] - codes[0])
        self._low_code, self._high_code = min(codes), max(codes)
        # A range that needs codes above 32767 is unsigned; any other fits into 16 bits with sign.
        self._signed = self._high_code <= _HIGHEST_SIGNED
        # A code at 0 V is a normal reading of a unipolar converter, not a sign of saturation.
        self._ends = {code for code, value in zip(codes, values, strict=True) if value != 0.0}

    def code_of(self, word: int) -> int:
        """Return the code of a 16-bit word, with its sign. Real-time safe."""
        return word - _WORDS if self._signed and word > _HIGHEST_SIGNED else word

    def value_of(self, word: int) -> float:
        """Return the value of a word, NaN if its code is out of range. Real-time safe."""
        return self.read(word)[0]

    def read(self, word: int) -> tuple[float, bool]:
        """Return `value_of`, and whether the converter is saturated. Real-time safe.

        It counts as saturated at both ends of its range, except at an end whose value is 0.
        """
        code = self.code_of(word)
        if not self._low_code <= code <= self._high_code:
            return nan, True
        return self._first + (code - self._first_code) * self._gain, code in self._ends

    def word_of(self, value: float) -> int:
        """Return the word of the code nearest to a value in range. Real-time safe."""
        code = self._first_code + round((value - self._first) / self._gain)
        # Rounding may leave the range by one code. The modulo gives a negative code as two's
        # complement.
        return min(max(code, self._low_code), self._high_code) % _WORDS


def pack(words: Sequence[int]) -> bytes:
    """Return process data that consists of these words. Real-time safe."""
    return _DATA[len(words)].pack(*words)


def unpack(data: bytes, n_words: int) -> tuple[int, ...]:
    """Return the words of process data. Real-time safe.

    Raises:
        LineFault: `GARBAGE` if the data is shorter. Bytes behind the words count for nothing: CiA
            301 allows a PDO to be longer than its mapping.
    """
    if len(data) < 2 * n_words:
        what = f"process data has {len(data)} bytes, {2 * n_words} are mapped"
        raise LineFault(DeviceFlag.GARBAGE, what)
    return _DATA[n_words].unpack_from(data)
