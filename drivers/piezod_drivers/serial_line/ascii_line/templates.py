"""Commands with places for values: `MOVEX {x:.3f}u`."""

import re
from collections.abc import Mapping
from string import Formatter
from typing import Annotated, Final, NamedTuple, TypeAlias

from pydantic import AfterValidator, StringConstraints

from piezod.config.fields import broken_rule

USUAL_SPEC: Final = ".4f"
TAG: Final = "n"
"""The name of the number that goes round, so that an answer names its command."""

_SPEC: Final = re.compile(r"[+ ]?0?\d{0,2}(?:\.\d{1,2})?[feEgG]", re.ASCII)
_TAG_SPEC: Final = re.compile(r"(?:0\dd?)?", re.ASCII)


class Placeholder(NamedTuple):
    """A place for a value.

    Attributes:
        before: What is sent before it.
        name: Whose value it is, "" for none after the last text.
        spec: How it is written, as Python's `format` takes it.
    """

    before: str
    name: str
    spec: str


def parsed(template: str) -> tuple[Placeholder, ...]:
    """Read a command.

    Raises:
        ValueError: If it has anything but names and formats of numbers in braces.
    """
    places = []
    for before, name, spec, conversion in Formatter().parse(template):
        if name is not None:
            _check(name, spec or "", conversion)
        written = "" if name is None else spec or ("" if name == TAG else USUAL_SPEC)
        places.append(Placeholder(before, name or "", written))
    return tuple(places)


def _check(name: str, spec: str, conversion: str | None) -> None:
    if not name.isidentifier():
        raise ValueError(f"{{{name}}} names no channel; write {{{{ and }}}} for braces themselves")
    allowed = _TAG_SPEC if name == TAG else _SPEC
    if conversion or (spec and allowed.fullmatch(spec) is None):
        example = "{n} or {n:03d}" if name == TAG else f"{{{name}:.3f}}"
        raise ValueError(f"{name} has a format that is not allowed, write it as {example}")


def names_of(template: str) -> list[str]:
    """Return whose values a command has, in their order; one that `parsed` accepts."""
    return [place.name for place in parsed(template) if place.name]


def filled(places: tuple[Placeholder, ...], values: Mapping[str, float]) -> str:
    """Return a command with its values; may be called in the loop."""
    return "".join(
        place.before + (format(values[place.name], place.spec) if place.name else "")
        for place in places
    )


def _checked(template: str) -> str:
    try:
        parsed(template)
    except ValueError as error:
        raise broken_rule(f"{error} (got {template!r})") from error
    return template


Template: TypeAlias = Annotated[str, StringConstraints(max_length=200), AfterValidator(_checked)]
"""A command without its terminator."""
