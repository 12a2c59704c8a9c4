"""Values of channels as 16 bit codes, and codes as process data."""

from collections.abc import Sequence
from math import nan
from struct import Struct
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag

_HIGHEST_SIGNED: Final = 0x7FFF
_WORDS: Final = 0x1_0000
_MOST_ENTRIES: Final = 8
"""In a mapping, whatever a node says."""
_DATA: Final = tuple(Struct(f"<{n_words}H") for n_words in range(_MOST_ENTRIES + 1))
"""Process data by how many words they have."""


class Scale:
    """Converts between codes of a channel and values in its unit, in a straight line.

    Args:
        codes: The codes at the lowest and at the highest value, from -32768 to 32767 or from 0 to
            65535.
        values: The lowest and the highest value.
    """

    def __init__(self, codes: tuple[int, int], values: tuple[float, float]) -> None:
        self._first_code, self._first = codes[0], values[0]
        self._gain = (values[1] - values[0]) / (codes[1] - codes[0])
        self._low_code, self._high_code = min(codes), max(codes)
        self._signed = self._high_code <= _HIGHEST_SIGNED
        # Zero is where nothing is, and no end of a converter's range.
        self._ends = {code for code, value in zip(codes, values, strict=True) if value != 0.0}

    def code_of(self, word: int) -> int:
        """Return the code that 16 bits stand for; may be called in the loop."""
        return word - _WORDS if self._signed and word > _HIGHEST_SIGNED else word

    def value_of(self, word: int) -> float:
        """Return the value that 16 bits stand for, NaN beyond the codes; in the loop too."""
        return self.read(word)[0]

    def read(self, word: int) -> tuple[float, bool]:
        """Return `value_of`, and whether the converter can show no more; may be called in the loop.

        The ends of its range are told, but for zero.
        """
        code = self.code_of(word)
        if not self._low_code <= code <= self._high_code:
            return nan, True
        return self._first + (code - self._first_code) * self._gain, code in self._ends

    def word_of(self, value: float) -> int:
        """Return 16 bits for the code next to a value, which is in range; in the loop too."""
        code = self._first_code + round((value - self._first) / self._gain)
        return min(max(code, self._low_code), self._high_code) % _WORDS


def pack(words: Sequence[int]) -> bytes:
    """Return process data with these 16 bit words; may be called in the loop."""
    return _DATA[len(words)].pack(*words)


def unpack(data: bytes, n_words: int) -> tuple[int, ...]:
    """Return the 16 bit words of process data; may be called in the loop.

    Raises:
        LineFault: `GARBAGE` if it has another length.
    """
    if len(data) != 2 * n_words:
        what = f"{len(data)} bytes of process data came where {2 * n_words} are mapped"
        raise LineFault(DeviceFlag.GARBAGE, what)
    return _DATA[n_words].unpack(data)
