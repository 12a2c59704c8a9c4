"""Detects files, sockets and processes that a piece of code opens."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Final

_IO_EVENTS: Final = ("open", "socket.", "subprocess.", "os.", "fcntl.", "mmap.", "pty.", "ctypes.")

_seen_by_thread: dict[int, list[str]] = {}


@contextmanager
def watch_io() -> Iterator[list[str]]:
    """Collect the input and output of this thread, as names of Python's audit events.

    Import modules and compile kernels before: both read files. Watches cannot be nested.

    Yields:
        Names of the events so far; empty without input and output.
    """
    _install_hook()
    seen = _seen_by_thread[threading.get_ident()] = []
    try:
        yield seen
    finally:
        del _seen_by_thread[threading.get_ident()]


@cache  # once: the interpreter has no way to remove an audit hook
def _install_hook() -> None:
    sys.addaudithook(_hook)


def _hook(event: str, _arguments: tuple[object, ...]) -> None:  # pragma: no cover - never traced
    seen = _seen_by_thread.get(threading.get_ident())
    if seen is not None and event.startswith(_IO_EVENTS):
        seen.append(event)
