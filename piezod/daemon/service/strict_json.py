"""Strict JSON for bodies of unknown clients: unambiguous, finite, of limited depth."""

import json
import math
from typing import Any, Final, NoReturn

from piezod.daemon.service.refusals import BadJsonError

MAX_DEPTH: Final = 16
_LARGEST_WHOLE: Final = 2**53
_MAX_DIGITS: Final = 18  # of whole numbers, so that they fit into 64 bits


def loads(text: bytes) -> Any:
    """Read a JSON document; lists become tuples, which strict validation requires.

    Raises:
        BadJsonError: If the text is not UTF-8 or not JSON, has a key twice, is nested deeper than
            16 levels, or has a number that is not finite or a whole number of more than 18 digits.
    """
    try:
        return _tuples(_DECODER.decode(text.decode()), MAX_DEPTH)
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:  # of decoding UTF-8, and of JSON
        raise BadJsonError(f"the body is not JSON: {error}") from error


def _tuples(value: Any, depth: int) -> Any:
    if isinstance(value, dict | list) and depth == 0:
        raise _too_deep()
    if isinstance(value, dict):
        return {_text(key): _tuples(entry, depth - 1) for key, entry in value.items()}
    if isinstance(value, list):
        return tuple([_tuples(entry, depth - 1) for entry in value])
    return _text(value) if isinstance(value, str) else value


def _text(text: str) -> str:
    text.encode()  # half a surrogate pair cannot be written to a log or an answer
    return text


def _too_deep() -> BadJsonError:
    return BadJsonError(f"nested too deeply, allowed: at most {MAX_DEPTH} levels")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise BadJsonError(f"the key {twice[:40]!r} occurs twice, allowed: once")
    return found


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > _MAX_DIGITS:
        what = f"a whole number has {len(digits)} digits, allowed: at most {_MAX_DIGITS}"
        raise BadJsonError(what)
    return int(digits)


def _number(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise BadJsonError(f"the number {digits[:40]} is too large")
    # In JSON 190.0 is a whole number like 190; floats without a fraction convert exactly.
    return int(value) if value.is_integer() and abs(value) < _LARGEST_WHOLE else value


def _constant(name: str) -> NoReturn:
    raise BadJsonError(f"{name} is not JSON, allowed: finite numbers")


_DECODER: Final = json.JSONDecoder(
    object_pairs_hook=_object,
    parse_int=_whole,
    parse_float=_number,
    parse_constant=_constant,
)
