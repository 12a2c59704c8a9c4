"""What a configuration key may contain: unit, range and default, from its annotation."""

import builtins
import collections.abc
import re
import types
import typing
from collections.abc import Iterable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args, get_origin

from annotated_types import MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from docs.site.reference.text import code
from piezod.config.fields import Quantity
from piezod.config.quantities import Name
from piezod.config.response_file import ResponseFile

_WORDS: Final = {str: "text", float: "number", int: "whole number", Path: "path of a file"}
APART: Final[dict[type[BaseModel], str]] = {
    BaseModel: "[options of the driver](drivers.md)",
    ResponseFile: "path of a [response file](../response.md)",
}
"""What has no section of its own."""
_NAME: Final = get_args(Name)[1]


class Allowed(NamedTuple):
    """What a key may contain.

    Attributes:
        unit: The unit of a number, "" without one.
        text: The range or the allowed words.
    """

    unit: str
    text: str


def allowed(field: FieldInfo) -> Allowed:
    """Return what a key may contain."""
    return _allowed(field.annotation, tuple(field.metadata))


def default(field: FieldInfo) -> str:
    """Return the default of a key."""
    value = field.get_default(call_default_factory=False)
    if field.is_required():
        return "required"
    if value is None or value is PydanticUndefined:
        return "–"
    if value in ("", (), {}):
        return "empty"
    if isinstance(value, BaseModel):
        return "its defaults"
    if isinstance(value, bool):
        return code(str(value).lower())
    return code(f"{value:g}" if isinstance(value, float) else value)


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that an annotation names, without those of their fields."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_in(part)


def title(model: type[BaseModel]) -> str:
    """Return the title of the section of a model: its `kind`, or the words of its name."""
    kind = model.model_fields.get("kind")
    if kind is not None:
        return str(kind.default) if isinstance(kind.default, str) else get_args(kind.annotation)[0]
    words = re.findall("[A-Z][a-z]*", model.__name__.removesuffix("Config"))
    return " ".join(words).capitalize()


def anchor(model: type[BaseModel]) -> str:
    """Return the anchor of the section of a model."""
    return model.__name__.lower()


def _allowed(annotation: Any, metadata: Iterable[Any]) -> Allowed:
    for each in metadata:
        if isinstance(each, Quantity):
            return Allowed(each.unit, f"{each.low:.12g} to {each.high:.12g}")
        if each is _NAME:
            return Allowed("", "name")
    arguments = get_args(annotation)
    match get_origin(annotation):
        case typing.Annotated:
            found = _allowed(arguments[0], (*arguments[1:], *metadata))
        case typing.Union | types.UnionType:
            found = _union([part for part in arguments if part is not type(None)])
        case builtins.tuple | builtins.list:
            found = _sequence(arguments, metadata)
        case builtins.dict | collections.abc.Mapping:
            found = Allowed("", f"name: {_allowed(arguments[1], ()).text}")
        case typing.Literal:
            found = Allowed("", ", ".join(map(code, arguments)))
        case _:
            found = Allowed("", _plain(annotation))
    return found


def _union(parts: list[Any]) -> Allowed:
    each = [_allowed(part, ()) for part in parts]
    unit = next((one.unit for one in each if one.unit), "")
    return Allowed(unit, " or ".join(one.text for one in each))


def _sequence(arguments: tuple[Any, ...], metadata: Iterable[Any]) -> Allowed:
    one = _allowed(arguments[0], ())
    if Ellipsis not in arguments and len(arguments) > 1:
        return Allowed(one.unit, f"{len(arguments)} values: {one.text}")
    least = next((each.min_length for each in metadata if isinstance(each, MinLen)), 0)
    most = next((each.max_length for each in metadata if isinstance(each, MaxLen)), None)
    number = f"{least} to {most}" if most is not None else f"{least} or more"
    return Allowed(one.unit, f"list of {number}: {one.text}")


def _plain(annotation: Any) -> str:
    if annotation is bool:
        return "`false`, `true`"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return ", ".join(code(member.value) for member in annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return APART.get(annotation) or f"[{title(annotation)}](#{anchor(annotation)})"
    return _WORDS.get(annotation, "value")
