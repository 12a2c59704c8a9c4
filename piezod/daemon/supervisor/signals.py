"""Records the signals of a daemon from its first moment on; imports only the standard library."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

_ENDING: Final = (signal.SIGTERM, signal.SIGINT)


class Signals:
    """The signals that were received.

    Attributes:
        end: Name of the first signal that ends the daemon; empty before that.
    """

    def __init__(self) -> None:
        self.end = ""
        self._reload = False

    def take_reload(self) -> bool:
        """Return whether SIGHUP came since the last call."""
        reload, self._reload = self._reload, False
        return reload

    def receive(self, number: int, _frame: FrameType | None = None) -> None:
        """Record a signal; of those that end the daemon, the first counts."""
        if number == signal.SIGHUP:
            self._reload = True
        else:
            self.end = self.end or signal.Signals(number).name


@contextmanager
def noted_signals() -> Iterator[Signals]:
    """Record SIGTERM, SIGINT and SIGHUP while the block runs, instead of their former handlers.

    asyncio's own handlers would not do: it removes them before the process has ended.
    """
    signals = Signals()
    before = {each: signal.signal(each, signals.receive) for each in (*_ENDING, signal.SIGHUP)}
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
