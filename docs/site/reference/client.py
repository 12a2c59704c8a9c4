"""The Python client, from its docstrings."""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any, Final

from docs.site.reference.text import code, docstring, table
from piezod import errors
from piezod.client import StageClient
from piezod.client.arrival import Arrival
from piezod.client.commands import StageCommands
from piezod.client.reports import StageReports
from piezod.messages import answers, stores, telemetry
from piezod.messages.documents import attributes
from tests.command_table import CONNECTION

_WIDTH: Final = 84
"""Longest signature on one line."""
_MODULE: Final = re.compile(r"\b[a-z_]\w*\.(?:[a-z_]\w*\.)*(?=[A-Z])")
_QUOTED: Final = re.compile(r"'([A-Z][^']*)'")
_GROUPS: Final = {
    "Requests to the loop": StageCommands,
    "Questions, parameters and recordings": StageReports,
    "Movements, streams and telemetry": StageClient,
}


def page() -> Iterator[str]:
    """Yield the page."""
    yield "# Python client"
    yield ""
    yield "[Moving a stage from a script](../client.md#in-python) has examples. `AsyncStageClient`"
    yield "has the same methods as coroutines."
    yield from _documented(StageClient, "## `StageClient`", inspect.signature(StageClient))
    for title, owner in _GROUPS.items():
        yield f"\n## {title}\n"
        for name in vars(owner):
            if name[0] != "_" and name not in CONNECTION:
                method = getattr(StageClient, name)
                yield from _documented(method, f"### `{name}`", inspect.signature(method))
    yield "\n## Results\n"
    for each in _results():
        yield from _documented(each, f"### `{each.__name__}`", None)
    yield "\n## Errors\n"
    yield from table(("error", "base", "when"), _errors())


def _documented(thing: Any, heading: str, signature: inspect.Signature | None) -> Iterator[str]:
    yield f"\n{heading} {{ #{thing.__name__} }}\n"
    if signature is not None:
        yield f"```python\n{_source(thing, signature)}\n```\n"
    about = docstring(thing)
    yield about.text
    if isinstance(thing, type) and is_dataclass(thing):
        about.entries["Attributes"] = attributes(thing)
    for section, head in (("Args", "argument"), ("Attributes", "attribute"), ("Raises", "error")):
        entries = about.entries.get(section, {}).items()
        yield from table((head, "meaning"), ((code(name), text) for name, text in entries))
    for section, text in about.others.items():
        yield f"\n{section}: {text}\n"


def _source(thing: Any, signature: inspect.Signature) -> str:
    parameters = [each for name, each in signature.parameters.items() if name != "self"]
    returned = signature.return_annotation or inspect.Signature.empty  # a class returns None
    plain = str(signature.replace(parameters=parameters, return_annotation=returned))
    source: str = thing.__name__ + _plain(plain)
    if len(source) <= _WIDTH:
        return source
    lines = "".join(f"    {_plain(str(each))},\n" for each in parameters)
    star = next((str(each) for each in parameters if each.kind is each.KEYWORD_ONLY), "")
    lines = lines.replace(f"    {_plain(star)},", f"    *,\n    {_plain(star)},", 1 if star else 0)
    return f"{thing.__name__}(\n{lines}){source.rpartition(')')[2]}"


def _plain(annotated: str) -> str:
    """Return source text without the modules of classes, and without quoted annotations."""
    return _QUOTED.sub(r"\1", _MODULE.sub("", annotated))


def _results() -> list[type[Any]]:
    """Return the classes of results, without their base."""
    own = [
        each
        for module in (answers, stores, telemetry)
        for each in vars(module).values()
        if is_dataclass(each) and isinstance(each, type) and each.__module__ == module.__name__
    ]
    return [*(each for each in own if fields(each)), Arrival]


def _errors() -> Iterator[tuple[str, str, str]]:
    for each in vars(errors).values():
        if isinstance(each, type) and issubclass(each, errors.ClientError):
            first = docstring(each).text.partition("\n\n")[0]
            yield code(each.__name__), code(each.__bases__[0].__name__), first
