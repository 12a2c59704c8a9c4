"""The stream of measured values. Everything is pure. Real-time safe.

A value of 18 bits consists of three bytes, whose upper two bits give their order: 00, then 01, then
10 for the first value of a measurement or 11 for an additional one. A value of 14 bits consists of
two bytes with the top bits 1 and 0. Any flipped bit among these flags breaks the word, which is
then dropped. A flipped bit in the value cannot be detected.
"""

import re
from typing import Final, NamedTuple

MAX_BYTES: Final = 4095
"""A kernel buffer of a port is full at this size: later bytes were lost."""

_WORD: Final = {
    2: re.compile(rb"[\x80-\xff][\x00-\x7f]"),
    3: re.compile(rb"[\x00-\x3f][\x40-\x7f][\x80-\xff]"),
}
_BEGUN: Final = {
    2: re.compile(rb"[\x80-\xff]?"),
    3: re.compile(rb"(?:[\x00-\x3f][\x40-\x7f]?)?"),
}
_ADDITIONAL: Final = 0xC0  # both top bits of the third byte


class NewestValue(NamedTuple):
    """The result of searching a part of a stream."""

    value: int | None  #: The last complete value, None if there is none.
    rest: bytes  #: The bytes of an incomplete word at the end.
    broken: bool  #: Whether there were bytes that belong to no word.


def newest(got: bytes, word_bytes: int) -> NewestValue:
    """Return the last value in a part of a stream that begins with a word, and the rest.

    Args:
        got: Bytes; at most the last `MAX_BYTES` are searched.
        word_bytes: Number of bytes of a word, 2 or 3.
    """
    got = got[-MAX_BYTES:]
    value, end, words = None, 0, 0
    for found in _WORD[word_bytes].finditer(got):
        word, end = found[0], found.end()
        words += word_bytes
        # Additional values of a measurement, such as the intensity, are skipped.
        if word_bytes == 2 or word[2] < _ADDITIONAL:
            value = count_of(word)
    # Nothing before, between or behind the words: nearly always so.
    if end == words == len(got):
        return NewestValue(value, b"", False)
    rest = got[end:]
    # The longest end of the rest that may be the start of a word.
    begun = next(
        part
        for part in (rest[max(len(rest) - n, 0) :] for n in range(word_bytes - 1, -1, -1))
        if _BEGUN[word_bytes].fullmatch(part)
    )
    return NewestValue(value, begun, end > words or len(begun) < len(rest))


def count_of(word: bytes) -> int:
    """Return the value of a word."""
    if len(word) == 2:
        # Seven bits in each byte, the highest byte first.
        return (word[0] & 0x7F) << 7 | word[1]
    # Six bits in each byte, the lowest byte first.
    return word[0] | (word[1] & 0x3F) << 6 | (word[2] & 0x3F) << 12


def text_of(got: bytes, word_bytes: int) -> str:
    """Return the text between the words of a stream."""
    return _WORD[word_bytes].sub(b"", got).decode("ascii", "ignore")
