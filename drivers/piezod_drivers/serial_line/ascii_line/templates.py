"""Commands with placeholders for values, such as `MOVEX {x:.3f}u`."""

import re
from collections.abc import Mapping
from string import Formatter
from typing import Annotated, Final, NamedTuple, TypeAlias

from pydantic import AfterValidator, StringConstraints

from piezod.config.fields import broken_rule

DEFAULT_SPEC: Final = ".4f"
TAG: Final = "n"
"""Name of the running number, which relates a reply to its command."""

_SPEC: Final = re.compile(r"[+ ]?0?\d{0,2}(?:\.\d{1,2})?[feEgG]", re.ASCII)
# The running number is a whole number below 1000: only its width can be chosen.
_TAG_SPEC: Final = re.compile(r"(?:0\dd?)?", re.ASCII)


class Placeholder(NamedTuple):
    """A placeholder for a value, and the text before it."""

    before: str  #: Text before it.
    name: str  #: Name of the value, "" for the end of the command.
    spec: str  #: Format as in Python's `format`.


def parsed(template: str) -> tuple[Placeholder, ...]:
    """Return the placeholders of a command.

    Raises:
        ValueError: If braces contain anything but names and formats of numbers.
    """
    places = []
    for before, name, spec, conversion in Formatter().parse(template):
        if name is not None:
            _check(name, spec or "", conversion)
        written = "" if name is None else spec or ("" if name == TAG else DEFAULT_SPEC)
        places.append(Placeholder(before, name or "", written))
    return tuple(places)


def _check(name: str, spec: str, conversion: str | None) -> None:
    # Excludes attributes and indices such as {x.real}, which `format` would evaluate.
    if not name.isidentifier():
        raise ValueError(f"{{{name}}} names no channel; write {{{{ and }}}} for braces")
    allowed = _TAG_SPEC if name == TAG else _SPEC
    if conversion or (spec and allowed.fullmatch(spec) is None):
        example = "{n} or {n:03d}" if name == TAG else f"{{{name}:.3f}}"
        raise ValueError(f"the format of {name} is not allowed, use for example {example}")


def names_of(template: str) -> list[str]:
    """Return the names of the values of a command, in order; `parsed` must accept it."""
    return [place.name for place in parsed(template) if place.name]


def fill(places: tuple[Placeholder, ...], values: Mapping[str, float]) -> str:
    """Return a command with its values. Real-time safe."""
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
