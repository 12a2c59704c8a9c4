"""Messages as JSON. An unknown number is None, because JSON has no NaN."""

import inspect
import json
import math
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cached_property
from typing import Any, Final, TypeAlias

Document: TypeAlias = dict[str, Any]
"""A JSON object."""


_ATTRIBUTE: Final = re.compile(r"^ {4}(\w+): (.+(?:\n {8}.+)*)", re.MULTILINE)
"""One entry of an "Attributes:" section, with its continued lines."""


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
    """Return what the fields of a class and of its bases mean, as their docstrings say."""
    texts = (inspect.cleandoc(each.__doc__ or "") for each in reversed(declared.__mro__))
    sections = (text.partition("Attributes:\n")[2] for text in texts)
    return {
        name: " ".join(text.split())
        for section in sections
        for name, text in _ATTRIBUTE.findall(section)
    }


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
