"""Progress of a command: a bar for people, lines of JSON for a program that asks for them."""

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.progress import (
    BarColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from piezod.cli.output import error_console
from piezod.messages.documents import plain

AS_JSON: Final = "PIEZOD_PROGRESS"
"""Environment variable: with the value `json`, progress is printed to stderr as lines of JSON."""
_STEP: Final = 0.005
"""Smallest step of the share that is printed."""


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """Show progress on stderr until the block ends: a bar if stderr is a terminal.

    Yields:
        A function of the present activity and of the share done, 0 to 1.
    """
    if _is_json():
        yield _Lines()
        return
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=error_console(),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    with bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda label, share: bar.update(task, description=label, completed=share)


def report_part(document: dict[str, object]) -> bool:
    """Print a part of the result as soon as it is known, if progress is printed as JSON.

    Returns:
        Whether it was printed.
    """
    if wanted := _is_json():
        _print({"part": document})
    return wanted


class _Lines:
    """Prints each step of the share, and each new activity."""

    def __init__(self) -> None:
        self._printed = ("", -1.0)

    def __call__(self, activity: str, share: float) -> None:
        printed, at = self._printed
        if activity != printed or abs(share - at) >= _STEP:
            self._printed = activity, share
            _print({"activity": activity, "share": share})


def _is_json() -> bool:
    return os.environ.get(AS_JSON) == "json"


def _print(document: dict[str, object]) -> None:
    # A page cannot read NaN, which JSON lacks: it becomes null.
    print(json.dumps(plain(document), allow_nan=False), file=sys.stderr, flush=True)
