"""Ctrl-C: it ends the command at any moment, with one line of text and its own exit code."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sys import UnraisableHookArgs  # exists for type checkers only

INTERRUPTED: Final = 130
TEXT: Final = "interrupted"
ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(BaseException):
    """Raised by Ctrl-C instead of KeyboardInterrupt, which typer would turn into an exit."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Make Ctrl-C raise `Interrupted` in the block, or end the process if nothing can be raised.

    The exception closes everything that is open: devices go to rest, and no half-written file
    stays. It is raised once, so that a second Ctrl-C does not disturb the closing. In a destructor
    or a callback of the garbage collector, which often run while figures are drawn, Python only
    reports an exception; the process then ends at once.
    """
    hook, handler = sys.unraisablehook, signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _end_if_interrupted
    try:
        yield
    finally:
        sys.unraisablehook = hook
        signal.signal(signal.SIGINT, handler)


@contextmanager
def unwinding() -> Iterator[None]:
    """Make SIGTERM and SIGHUP act like Ctrl-C in the block, for a command that drives devices."""
    before = {each: signal.signal(each, _interrupt) for each in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    """End the command once; later signals do not interrupt the return of a stage."""
    for number in ENDING:
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, _ignore)
    raise Interrupted


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing; with SIG_IGN, Python would report a signal that came at the same time."""


def _end_if_interrupted(unraisable: "UnraisableHookArgs") -> None:
    if not issubclass(unraisable.exc_type, Interrupted | KeyboardInterrupt):
        sys.__unraisablehook__(unraisable)
        return
    if sys.stderr.isatty():
        os.write(2, b"\r\x1b[2K\x1b[?25h")  # clear the progress bar, show the cursor that it hid
    os.write(2, f"{TEXT}\n".encode())
    os._exit(INTERRUPTED)
