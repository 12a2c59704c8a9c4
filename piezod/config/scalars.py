"""Meaning of words without quotes: the core schema of YAML 1.2.

PyYAML's own resolver follows YAML 1.1, in which `yes` is true, `1e3` is a text, `10:30` is 630 and
`2024-01-02` is a date. Here `1e3` is a number, and `yes`, `on`, `10:30` and dates are texts.
"""

import math
import re
from typing import Final, TypeAlias

Scalar: TypeAlias = bool | int | float | str | None

_WORDS: Final[dict[str, Scalar]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), math.inf),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), -math.inf),
}
_DECIMAL: Final = re.compile(r"[-+]?[0-9]+")
_OCTAL: Final = re.compile(r"0o[0-7]+")
_HEX: Final = re.compile(r"0x[0-9a-fA-F]+")
NUMBER: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_MAX_LENGTH: Final = 100
"""Largest number of characters; the time to convert a number grows with their square."""


def resolve(text: str) -> Scalar:
    """Return the value of a plain scalar, that is of a word or number without quotes.

    A number too large for double precision becomes infinite, as in other readers.

    Raises:
        ValueError: If it is a whole number beyond 64 bits, or a number with too many digits.
    """
    if text in _WORDS:
        return _WORDS[text]
    for pattern, base in ((_DECIMAL, 10), (_OCTAL, 8), (_HEX, 16)):
        if pattern.fullmatch(text):
            return _whole_number(text, base)
    if NUMBER.fullmatch(text):
        _check_length(text)
        return float(text)
    return text


def _whole_number(text: str, base: int) -> int:
    _check_length(text)
    number = int(text.removeprefix("0o").removeprefix("0x"), base)
    if not -(2**63) <= number < 2**63:
        raise ValueError("whole number beyond 64 bits")
    return number


def _check_length(text: str) -> None:
    if len(text) > _MAX_LENGTH:
        raise ValueError(f"number of more than {_MAX_LENGTH} characters")
