"""Wording of error messages: the problem (got …), the allowed values."""

import difflib
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_MAX_SHOWN: Final = 40

# pydantic's error type → problem, allowed values; placeholders come from the error's context.
_WORDINGS: Final[dict[str, tuple[str, str]]] = {
    "bool_type": ("must be true or false", ""),
    "dict_type": ("must be a mapping, lines of `key: value`", ""),
    "finite_number": ("must be a finite number", ""),
    "float_parsing": ("must be a number", ""),
    "float_type": ("must be a number", ""),
    "greater_than": ("too small", ", allowed: more than {gt}"),
    "greater_than_equal": ("too small", ", allowed: at least {ge}"),
    "int_from_float": ("must be a whole number", ""),
    "int_parsing": ("must be a whole number", ""),
    "int_type": ("must be a whole number", ""),
    "less_than": ("too large", ", allowed: less than {lt}"),
    "less_than_equal": ("too large", ", allowed: at most {le}"),
    "model_attributes_type": ("must be a mapping, lines of `key: value`", ""),
    "model_type": ("must be a mapping, lines of `key: value`", ""),
    "string_pattern_mismatch": ("not well formed", ", allowed pattern {pattern}"),
    "string_too_long": ("too long", ", allowed: at most {max_length} characters"),
    "string_too_short": ("too short", ", allowed: at least {min_length} characters"),
    "string_type": ("must be a text", ""),
    "tuple_type": ("must be a list", ""),
    "value_error": ("{error}", ""),
}
# The same for errors without a value: it would be a mapping or list, or is in the text already.
_WORDINGS_WITHOUT_VALUE: Final[dict[str, str]] = {
    "rule": "{what}",
    "too_long": "too many entries (got {actual_length}), allowed: at most {max_length}",
    "too_short": "too few entries (got {actual_length}), allowed: at least {min_length}",
    "union_tag_not_found": "required key {discriminator} is missing",
}
# Errors that list the allowed words: name of the list in the context, and of the value.
_CHOICES: Final[dict[str, tuple[str, str]]] = {
    "enum": ("expected", "input"),
    "literal_error": ("expected", "input"),
    "union_tag_invalid": ("expected_tags", "tag"),
}
_NUMBERS: Final = ("float_parsing", "float_type", "int_parsing", "int_type")
_WITH_UNIT: Final = re.compile(r"\s*[-+]?[\d.]+(e[-+]?\d+)?\s*[^\W\d_]+(/[^\W\d_]+)?\s*")


def describe(error: "ErrorDetails", known_keys: Sequence[str]) -> str:
    """Return the message of one validation error.

    Args:
        error: The error from pydantic.
        known_keys: Known keys of the mapping in which an unknown key was found.
    """
    kind = error["type"]
    context = {"input": error["input"], **error.get("ctx", {})}
    if kind == "extra_forbidden":
        remedy = suggest(str(error["loc"][-1]), known_keys, "known keys")
        return f"unknown key, {remedy}" if known_keys else "unknown key"
    if kind == "missing":
        return f"required {'entry' if isinstance(error['loc'][-1], int) else 'key'} is missing"
    if kind in _WORDINGS_WITHOUT_VALUE:
        return _WORDINGS_WITHOUT_VALUE[kind].format_map(context)
    if kind in _CHOICES:
        listed, value = _CHOICES[kind]
        # pydantic gives the choices as one text: "'low' or 'middle'".
        choices = re.findall(r"'([^']*)'", context[listed]) or [context[listed]]
        found = context[value]
        if kind == "union_tag_invalid":  # pydantic's context has the tag in Python's notation
            found = error["input"][context["discriminator"].strip("'")]
        return f"unknown value (got {show(found)}), {suggest(str(found), choices, 'allowed')}"
    if kind in _WORDINGS:
        what, remedy = (part.format_map(context) for part in _WORDINGS[kind])
        if kind in _NUMBERS and _WITH_UNIT.fullmatch(str(error["input"])):
            what += " without its unit"
        return f"{what} (got {show(error['input'])}){remedy}"
    return f"{_plain(error['msg'])} (got {show(error['input'])})"


def _plain(message: str) -> str:
    """Return a message of pydantic in the style of the other messages."""
    message = re.sub(r"^(Value error|Assertion failed), ", "", message)
    return re.sub(r"^\w+ should ", "must ", message)


def suggest(word: str, known: Sequence[str], title: str) -> str:
    """Return the most similar known word, or all known words under a title."""
    close = difflib.get_close_matches(word, known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"{title}: {', '.join(known) or 'none'}"


def show(value: object) -> str:
    """Return a value as in a YAML file, shortened."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, tuple):
        return "a list"
    if value is None:
        return "nothing"
    if isinstance(value, bool):  # YAML writes true, Python True
        return str(value).lower()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value).replace("inf", ".inf").replace("nan", ".nan")
    text = repr(str(value) if isinstance(value, str) else value)
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}…"
