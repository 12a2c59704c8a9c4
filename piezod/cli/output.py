"""Output of commands: one JSON document, or text for people on a console.

rich is imported when something is shown, because it takes longer than a whole command with --json.
"""

import json
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from piezod.messages.documents import plain

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def print_json(document: Mapping[str, object]) -> None:
    """Print a document; NaN and infinities, which JSON lacks, become null."""
    json.dump(plain(document), sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")
    sys.stdout.flush()  # so that a full disk is an error with an exit code


def print_json_line(document: Mapping[str, object]) -> None:
    """Print a document as one line without delay; NaN and infinities become null."""
    json.dump(plain(document), sys.stdout, allow_nan=False)
    sys.stdout.write("\n")
    sys.stdout.flush()


def print_one(document: Mapping[str, object], text: str, *, json: bool) -> None:
    """Print a document, or in place of it a text for people."""
    if json:
        print_json(document)
    else:
        new_console().print(text, soft_wrap=True)


def print_warnings(console: "Console", warnings: Iterable[str]) -> None:
    """Print a line for each warning."""
    for warning in warnings:
        console.print(f"! {warning}", style="yellow")


def new_table(*left: str, right: Sequence[str] = (), no_wrap: bool = False) -> "Table":
    """Return an empty table.

    Args:
        left: Headings of its first columns.
        right: Headings of the columns behind them, which have numbers.
        no_wrap: Whether no cell goes on in another line.
    """
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for heading in left:
        table.add_column(heading, no_wrap=no_wrap)
    for heading in right:
        table.add_column(heading, justify="right", no_wrap=no_wrap)
    return table


def new_console() -> "Console":
    """Return a console for people, on stdout."""
    return _console(stderr=False)


def error_console() -> "Console":
    """Return a console for people, on stderr."""
    return _console(stderr=True)


def _console(*, stderr: bool) -> "Console":
    from rich.console import Console

    # With NO_COLOR rich leaves out colours but not bold text; without a colour system it leaves out
    # both. Numbers are not coloured, and brackets and colons in paths not interpreted.
    return Console(
        stderr=stderr,
        color_system=None if os.environ.get("NO_COLOR") else "auto",
        highlight=False,
        markup=False,
        emoji=False,
    )
