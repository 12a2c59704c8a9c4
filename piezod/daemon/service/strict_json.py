"""JSON as a service may take it from anybody: nothing that is read in two ways, nothing endless."""

import json
import math
from typing import Any, Final, NoReturn

from piezod.daemon.service.refusals import BadJsonError

MAX_DEPTH: Final = 16
_MAX_DIGITS: Final = 18  # of whole numbers: they all fit into 64 bits


def loads(text: bytes) -> Any:
    """Read a JSON document; lists become tuples, as strict validation wants them.

    Raises:
        BadJsonError: If it is not UTF-8 or no JSON, says a key twice, is nested deeper than 16
            levels, or has a number that is not finite or has more than 18 digits before the point.
    """
    try:
        return _tuples(_DECODER.decode(text.decode()), MAX_DEPTH)
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:  # of decoding UTF-8, and of JSON
        raise BadJsonError(f"the body is no JSON: {error}") from error


def _tuples(value: Any, depth: int) -> Any:
    if isinstance(value, dict | list) and depth == 0:
        raise _too_deep()
    if isinstance(value, dict):
        return {_text(key): _tuples(entry, depth - 1) for key, entry in value.items()}
    if isinstance(value, list):
        return tuple([_tuples(entry, depth - 1) for entry in value])
    return _text(value) if isinstance(value, str) else value


def _text(text: str) -> str:
    text.encode()  # half a surrogate pair could not be written into a log or an answer
    return text


def _too_deep() -> BadJsonError:
    return BadJsonError(f"nested too deeply, allowed: at most {MAX_DEPTH} levels")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise BadJsonError(f"the key {twice[:40]!r} is there twice, allowed: once")
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
    return value


def _constant(name: str) -> NoReturn:
    raise BadJsonError(f"{name} is no JSON, allowed: finite numbers")


_DECODER: Final = json.JSONDecoder(
    object_pairs_hook=_object,
    parse_int=_whole,
    parse_float=_number,
    parse_constant=_constant,
)
