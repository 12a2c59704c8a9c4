"""Markdown from docstrings and values."""

import inspect
import re
from collections.abc import Iterable, Iterator
from typing import Any, Final, NamedTuple

_SECTION: Final = re.compile(r"^(Args|Returns|Yields|Raises|Attributes):$", re.MULTILINE)
_ENTRY: Final = re.compile(r"^    (\S[^:\n]*): (.+(?:\n {8}.+)*)", re.MULTILINE)


class Docstring(NamedTuple):
    """A docstring in Google's format.

    Attributes:
        text: Everything before the first section, as Markdown.
        entries: Names and texts of the sections that have them, by section.
        others: Texts of the other sections, by section.
    """

    text: str
    entries: dict[str, dict[str, str]]
    others: dict[str, str]


def docstring(thing: Any) -> Docstring:
    """Return the docstring of a class or a function, without one that it inherits."""
    parts = _SECTION.split(inspect.cleandoc(thing.__doc__ or ""))
    text = re.sub(r"^::$", "", parts[0], flags=re.MULTILINE).strip()
    entries, others = {}, {}
    for name, body in zip(parts[1::2], parts[2::2], strict=True):
        found = {key: one_line(what) for key, what in _ENTRY.findall(body)}
        if name in {"Args", "Raises", "Attributes"}:
            entries[name] = found
        else:
            others[name] = one_line(body)
    return Docstring(text, entries, others)


def one_line(text: str) -> str:
    """Return a text on one line."""
    return " ".join(text.split())


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """Yield the lines of a table, between blank lines; none if there are no rows."""
    cells = [[_cell(cell) for cell in row] for row in rows]
    if cells:
        names = list(head)
        yield ""
        for row in (names, ["---"] * len(names), *cells):
            yield f"| {' | '.join(row)} |"
        yield ""


def code(value: object) -> str:
    """Return a value as code."""
    return f"`{value}`"


def sentence(text: str) -> str:
    """Return a text that begins with a capital and ends with a full stop."""
    text = one_line(text)
    if not text:
        return ""
    first = text if text.startswith("`") else text[0].upper() + text[1:]
    return first if first.endswith((".", "…")) else f"{first}."


def _cell(text: str) -> str:
    return one_line(text).replace("|", "\\|")
