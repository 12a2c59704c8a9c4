"""The texts that derive from the table of commands: `python -m tests.command_table` writes them.

The tests of the clients compare them with what is in the files.
"""

import inspect
from collections.abc import Generator, Iterator
from itertools import groupby
from pathlib import Path
from types import NoneType
from typing import Any, Final, get_args, get_origin

from typer.main import get_command

from piezod.cli.main import app
from piezod.client import StageClient
from piezod.client.commands import StageCommands
from piezod.client.reports import StageReports
from piezod.messages.endpoints import Endpoint, Role
from piezod.messages.requests import TABLE
from tests.man_page import loaded

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "client.md"
BEGIN: Final = "<!-- {}: made by `python -m tests.command_table`, begin -->\n"
END: Final = "<!-- end -->\n"
COMMON_OPTIONS: Final = {"stage", "socket", "json", "help"}
"""Options that every verb has; the page explains them once."""
CONNECTION: Final = ("call", "close")
"""Methods of the connection, not of the stage."""


def main() -> None:
    """Write the tables of the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the page about the client with its tables written anew."""
    text = PAGE.read_text(encoding="utf-8")
    tables = {"methods": method_table(), "endpoints": endpoint_table()}
    for name, lines in tables.items():
        before, begin, rest = text.partition(BEGIN.format(name))
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise ValueError(f"{PAGE} has no marks for the table of {name}")
        text = "".join((before, begin, *(f"{line}\n" for line in lines), end, after))
    return text


def method_table() -> Iterator[str]:
    """Yield the lines of the table of methods of the clients, by the type that they return."""
    returned: dict[str, list[str]] = {}
    for each in (StageCommands, StageReports, StageClient):
        for name in vars(each):
            if name[0] != "_" and name not in CONNECTION:
                annotation = inspect.signature(getattr(StageClient, name)).return_annotation
                returned.setdefault(_type_name(annotation), []).append(f"`{name}`")
    yield "| methods | return |"
    yield "|---|---|"
    for type_name, names in returned.items():
        yield f"| {' '.join(names)} | {type_name} |"


def endpoint_table() -> Iterator[str]:
    """Yield the lines of the table of endpoints, by the rights that they need."""
    rows = sorted(TABLE.values(), key=_rights)
    yield "| least role | lease | endpoints |"
    yield "|---|---|---|"
    for (role, lease), same in groupby(rows, _rights):
        endpoints = ", ".join(map(_endpoint, same))
        yield f"| {role.name.lower()} | {'needed' if lease else ''} | {endpoints} |"


def usage_of_verbs() -> dict[str, str]:
    """Return the usage of each verb of the command line, without the options of all verbs."""
    usages = {}
    for name, command in get_command(app).commands.items():  # type: ignore[attr-defined] # a group
        for word, each in getattr(command, "commands", {"": command}).items():
            words = f"{name} {word}".rstrip()
            usages[words] = " ".join((words, *_parameters(loaded(each))))
    return usages


def _parameters(command: Any) -> Iterator[str]:
    for parameter in command.params:
        if parameter.name in COMMON_OPTIONS:
            continue
        if parameter.param_type_name == "argument":
            yield parameter.metavar
        elif parameter.is_flag:
            yield f"[{parameter.opts[0]}]"
        else:
            yield f"[{parameter.opts[0]} {parameter.metavar}]"


def _rights(row: Endpoint) -> tuple[Role, bool]:
    return row.access.role, row.access.lease


def _endpoint(row: Endpoint) -> str:
    """Return method and path; in brackets a client's method of another name, and a larger body."""
    notes = [f"`{row.name}`"] if row.name != row.path else []
    if row.streamed:
        notes.append("lines of 1 KiB")
    elif row.access.most_bytes > 1024:
        notes.append(f"{row.access.most_bytes // 1024} KiB")
    return f"`{row.method} /v1/{row.path}`" + (f" ({', '.join(notes)})" if notes else "")


def _type_name(annotation: Any) -> str:
    if get_origin(annotation) is Generator:
        if get_args(annotation)[0] in {None, NoneType}:
            return "a context manager"
        return f"a generator of `{get_args(annotation)[0].__name__}`"
    return f"`{annotation.__name__}`"


if __name__ == "__main__":
    main()
