"""What signals ask of a daemon, noted from its first moment on; only the standard library."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

_ENDING: Final = (signal.SIGTERM, signal.SIGINT)


class Signals:
    """What was asked for so far; somebody looks at it now and then.

    Attributes:
        end: The signal that asked for the end; empty as long as none has.
    """

    def __init__(self) -> None:
        self.end = ""
        self._reload = False

    def take_reload(self) -> bool:
        """Tell whether SIGHUP came since the last call."""
        reload, self._reload = self._reload, False
        return reload

    def note(self, number: int, _frame: FrameType | None = None) -> None:
        """Note a signal; the first that asks for the end is the one that counts."""
        if number == signal.SIGHUP:
            self._reload = True
        else:
            self.end = self.end or signal.Signals(number).name


@contextmanager
def noted_signals() -> Iterator[Signals]:
    """Note SIGTERM, SIGINT and SIGHUP while the block runs, in place of what they did before.

    Not by asyncio, which takes its handlers away before the process has ended.
    """
    signals = Signals()
    before = {each: signal.signal(each, signals.note) for each in (*_ENDING, signal.SIGHUP)}
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
