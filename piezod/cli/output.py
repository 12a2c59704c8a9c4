"""Output of commands: one JSON document, or text for people on a console."""

import json
import os
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

from piezod.messages.documents import plain

if TYPE_CHECKING:
    from rich.console import Console


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
