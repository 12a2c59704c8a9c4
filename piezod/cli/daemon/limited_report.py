"""Refusals of a server on stderr: bounded, because a client can cause any number of them."""

import time
from collections.abc import Callable
from typing import Final

import typer

MOST_LINES: Final = 20
WINDOW_S: Final = 10.0


class LimitedReport:
    """Prints the first lines of each window of time, and how many it has left out.

    Args:
        write: Prints a line.
        now_s: The clock, in s.
    """

    def __init__(
        self,
        write: Callable[[str], None] = lambda text: typer.echo(text, err=True),
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._write, self._now_s = write, now_s
        self._begun_s, self._lines = now_s(), 0

    def __call__(self, text: str) -> None:
        """Print a line, unless there were too many within the last seconds."""
        now_s = self._now_s()
        if now_s - self._begun_s >= WINDOW_S:
            if self._lines > MOST_LINES:
                self._write(f"{self._lines - MOST_LINES} further lines were left out")
            self._begun_s, self._lines = now_s, 0
        self._lines += 1
        if self._lines <= MOST_LINES:
            self._write(text)
