"""Ctrl-C: the command ends, whatever it is doing, with one line and an exit code of its own."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

INTERRUPTED: Final = 130
TEXT: Final = "interrupted"
ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(BaseException):
    """Raised by Ctrl-C in place of KeyboardInterrupt, of which typer would make an exit."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Make Ctrl-C raise `Interrupted` in the block, and end the process where that is swallowed.

    An exception unwinds what is open: devices go to rest, no half-written files stay. It comes
    once: Ctrl-C again does not disturb that. Where Python cannot raise one, in a destructor or a
    callback of the garbage collector, as they run often while figures are drawn, it only reports
    it; there the process ends at once.
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
    """Have SIGTERM and SIGHUP do in the block what Ctrl-C does, for a verb that drives devices."""
    before = {each: signal.signal(each, _interrupt) for each in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    """End the command once: what it does then, as to bring a stage back, is not interrupted."""
    for number in ENDING:
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, _ignore)
    raise Interrupted


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing; SIG_IGN would have Python report a signal that came at the same time."""


def _end_if_interrupted(unraisable: "UnraisableHookArgs") -> None:
    if not issubclass(unraisable.exc_type, Interrupted | KeyboardInterrupt):
        sys.__unraisablehook__(unraisable)
        return
    if sys.stderr.isatty():
        os.write(2, b"\r\x1b[2K\x1b[?25h")  # the progress bar's line, and the cursor that it hid
    os.write(2, f"{TEXT}\n".encode())
    os._exit(INTERRUPTED)
