"""Messages as JSON. An unknown number is None, because JSON has no NaN."""

import inspect
import json
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from typing import Any, Final, TypeAlias

Document: TypeAlias = dict[str, Any]
"""A JSON object."""

_FIELD: Final = re.compile(r"^((?: {4}#: .+\n)*) {4}(\w+): .*?(?: {2}#: (.+))?$", re.MULTILINE)
"""A field of a class, with the comment before it or behind it."""


class Message:
    """Base of all answers: frozen dataclasses, which keep the document that they were read from."""

    @cached_property
    def document(self) -> Document:
        """The complete answer as JSON: a newer daemon may report more than the fields."""
        document: Document = plain(self)
        return document


def plain(value: Any) -> Any:
    """Return a message or a part of one as JSON has it; NaN and infinities become None."""
    if is_dataclass(value):
        value = _fields(value)
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def attributes(declared: type) -> dict[str, str]:
    """Return what the fields of a class and of its bases mean: the comments `#:` beside them.

    They are read from the source, so that each text stands in one place, beside its field.
    """
    found: dict[str, str] = {}
    for each in reversed(declared.__mro__):
        found |= _commented(each.__module__).get(each.__name__, {})
    return found


@cache
def _commented(module: str) -> dict[str, dict[str, str]]:
    """Return the comments of the fields of all classes of a module, by the names of the classes."""
    if module == "builtins":
        return {}
    source = inspect.getsource(sys.modules[module])
    classes = re.findall(r"^class (\w+)(.*?)(?=^[^\s)]|\Z)", source, re.MULTILINE | re.DOTALL)
    return {name: _comments(body) for name, body in classes}


def _comments(body: str) -> dict[str, str]:
    found = ((name, before or behind) for before, name, behind in _FIELD.findall(body))
    return {name: " ".join(text.replace("#:", "").split()) for name, text in found if text}


def dump(content: Any) -> bytes:
    """Return a message or plain data as compact JSON; NaN and infinities become null."""
    try:
        text = _dumps(content)
    except ValueError:
        text = _dumps(plain(content))
    return text.encode(errors="backslashreplace")  # bytes of a path that are no text


def _dumps(content: Any) -> str:
    return json.dumps(
        content, allow_nan=False, separators=(",", ":"), ensure_ascii=False, default=_fields
    )


def _fields(message: Any) -> Document:
    return {each.name: getattr(message, each.name) for each in fields(message)}
