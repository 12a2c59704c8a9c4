"""The stream of measured values; everything is pure and may be called in the loop.

A value of 18 bits comes as three bytes, whose upper two bits say which one they are: 00, then 01,
then 10 for the first value of a measurement or 11 for additional ones. One of 14 bits comes as two,
told apart by the top bit: 1, then 0. Any flipped bit among these flags breaks the word, which is
dropped; a flipped bit of the value cannot be told.
"""

import re
from typing import Final, NamedTuple

MOST_BYTES: Final = 4095
"""A port's buffer in the kernel is full with so many: what came then was lost."""

_WORD: Final = {
    2: re.compile(rb"[\x80-\xff][\x00-\x7f]"),
    3: re.compile(rb"[\x00-\x3f][\x40-\x7f][\x80-\xff]"),
}
_BEGUN: Final = {
    2: re.compile(rb"[\x80-\xff]?"),
    3: re.compile(rb"(?:[\x00-\x3f][\x40-\x7f]?)?"),
}
_ADDITIONAL: Final = 0xC0


class Newest(NamedTuple):
    """What a part of a stream tells.

    Attributes:
        value: The last one that is whole, None where there is none.
        rest: The bytes of a word that is not whole yet.
        broken: Whether there were bytes that belong to no word.
    """

    value: int | None
    rest: bytes
    broken: bool


def newest(got: bytes, word_bytes: int) -> Newest:
    """Return the last value in a part of a stream that begins with a word, and the rest.

    Args:
        got: Bytes; of very many only the last `MOST_BYTES` are looked at.
        word_bytes: 2 or 3.
    """
    got = got[-MOST_BYTES:]
    value, end, words = None, 0, 0
    for found in _WORD[word_bytes].finditer(got):
        word, end = found[0], found.end()
        words += word_bytes
        if word_bytes == 2 or word[2] < _ADDITIONAL:
            value = count_of(word)
    if end == words == len(got):
        return Newest(value, b"", False)
    rest = got[end:]
    begun = next(
        part
        for part in (rest[max(len(rest) - n, 0) :] for n in range(word_bytes - 1, -1, -1))
        if _BEGUN[word_bytes].fullmatch(part)
    )
    return Newest(value, begun, end > words or len(begun) < len(rest))


def count_of(word: bytes) -> int:
    """Return the value in a word."""
    if len(word) == 2:
        return (word[0] & 0x7F) << 7 | word[1]
    return word[0] | (word[1] & 0x3F) << 6 | (word[2] & 0x3F) << 12


def pack(count: int, word_bytes: int, *, additional: bool = False) -> bytes:
    """Return a value as a word."""
    if word_bytes == 2:
        return bytes((0x80 | count >> 7 & 0x7F, count & 0x7F))
    top = _ADDITIONAL if additional else 0x80
    return bytes((count & 0x3F, 0x40 | count >> 6 & 0x3F, top | count >> 12 & 0x3F))


def text_of(got: bytes, word_bytes: int) -> str:
    """Return the text that comes between the words of a stream."""
    return _WORD[word_bytes].sub(b"", got).decode("ascii", "ignore")
