"""Hands items to a slow consumer in a thread: to a disk or a terminal, for which nothing waits."""

import os
import select
import threading
from collections.abc import Callable
from contextlib import suppress
from queue import Full, Queue
from typing import Final, Generic, Self, TextIO, TypeVar

ItemT = TypeVar("ItemT")

MOST_ITEMS: Final = 1000
CLOSE_S: Final = 2.0
"""Longest wait at the end for a consumer that does not respond, in s."""


class Background(Generic[ItemT]):
    """Passes items to a function, in order, in a thread; drops and counts those that are too many.

    Args:
        name: Name of the thread.
        consume: Takes an item; it may block, and must not raise.
        report_lost: Takes the number of dropped items, when items are taken again.
        most: Largest number of items that wait.
    """

    def __init__(
        self,
        name: str,
        consume: Callable[[ItemT], None],
        report_lost: Callable[[int], None],
        most: int = MOST_ITEMS,
    ) -> None:
        self._consume, self._report_lost = consume, report_lost
        self._queue: Queue[ItemT | threading.Event | None] = Queue(most)
        self._lost = 0
        # A daemon thread: one that is blocked must not keep the process from ending.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Number of items that wait."""
        return self._queue.qsize()

    def put(self, item: ItemT) -> None:
        """Hand over an item, or drop it; never waits."""
        try:
            self._queue.put_nowait(item)
        except Full:
            self._lost += 1

    def flush(self, within_s: float) -> bool:
        """Wait until all items so far are consumed, at most this time in s; return whether."""
        done = threading.Event()
        try:
            self._queue.put(done, timeout=within_s)
        except Full:
            return False
        return done.wait(within_s)

    def close(self) -> bool:
        """End the thread after all items; return whether they were consumed in time."""
        consumed = self.flush(CLOSE_S)
        with suppress(Full):
            self._queue.put_nowait(None)
        return consumed

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            if not isinstance(item, threading.Event):
                self._consume(item)
            if self._lost and self._queue.empty():
                lost, self._lost = self._lost, 0
                self._report_lost(lost)
            if isinstance(item, threading.Event):
                item.set()


class BackgroundStream:
    """A stream for the log: lines are written in a thread, or dropped while nothing takes them.

    A terminal that was stopped by Ctrl-S, or a pipe that nobody reads, takes nothing.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._lines = Background[str](
            "log", self._write, lambda lost: self._write(f"{lost} lines of the log were dropped\n")
        )

    def write(self, text: str) -> int:
        """Hand over a text; never waits."""
        self._lines.put(text)
        return len(text)

    def flush(self) -> None:
        """Do nothing: the thread writes at once."""

    def fileno(self) -> int:
        """Return the file descriptor of the stream."""
        return self._stream.fileno()

    def isatty(self) -> bool:
        """Return whether the stream is a terminal."""
        return self._stream.isatty()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Write the last lines, if the stream takes them."""
        self._lines.close()

    def _write(self, text: str) -> None:
        try:
            file = self._stream.fileno()
        except OSError:  # it is only in memory
            self._stream.write(text)
            return
        # Not by the stream: at the end of the process its lock would still be held.
        rest = memoryview(text.encode(errors="replace"))
        while rest:
            try:
                rest = rest[os.write(file, rest) :]
            except BlockingIOError:
                select.select([], [file], [])
            except OSError:  # the terminal was closed
                return
