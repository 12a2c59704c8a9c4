"""Values of channels as 16 bit codes, and codes as process data."""

from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag

_HIGHEST_SIGNED: Final = 0x7FFF
_WORDS: Final = 0x1_0000


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
        code = self.code_of(word)
        if not self._low_code <= code <= self._high_code:
            return nan
        return self._first + (code - self._first_code) * self._gain

    def is_at_an_end(self, word: int) -> bool:
        """Tell whether the converter can show no more than this; may be called in the loop."""
        code = self.code_of(word)
        return code in self._ends or not self._low_code <= code <= self._high_code

    def word_of(self, value: float) -> int:
        """Return 16 bits for the code next to a value, which is in range; in the loop too."""
        code = self._first_code + round((value - self._first) / self._gain)
        return min(max(code, self._low_code), self._high_code) % _WORDS


def pack(words: Sequence[int]) -> bytes:
    """Return process data with these 16 bit words; may be called in the loop."""
    return b"".join([word.to_bytes(2, "little") for word in words])


def unpack(data: bytes, n_words: int) -> list[int]:
    """Return the 16 bit words of process data; may be called in the loop.

    Raises:
        LineFault: `GARBAGE` if it has another length.
    """
    if len(data) != 2 * n_words:
        what = f"{len(data)} bytes of process data came where {2 * n_words} are mapped"
        raise LineFault(DeviceFlag.GARBAGE, what)
    return [data[i] | data[i + 1] << 8 for i in range(0, 2 * n_words, 2)]
