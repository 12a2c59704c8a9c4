"""The heartbeat of the supervisor, by which the loop sees that it is alive."""

import threading
import time
from typing import Final

from piezod.daemon.stage.connection import LoopConnection
from piezod.units import s_to_ns

BEAT_S: Final = 0.1
"""Period of the beat, in s; the loop takes its supervisor for lost after 3 s without one, or
after 1 s if its process has ended."""
BUSY_S: Final = 3.0
"""If the event loop does not tick for longer, in s, the beat stops: the supervisor hangs. Equal to
WatchdogSec= of the unit."""


class Heartbeat:
    """Beats in a thread while the event loop is alive, even if that is busy for a while.

    Args:
        loop: The loop that sees the beat.
    """

    def __init__(self, loop: LoopConnection) -> None:
        self._loop = loop
        self._ticked_ns = 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)

    def start(self) -> None:
        """Start the thread; call it once."""
        self.tick(time.monotonic_ns())
        self._thread.start()

    def stop(self) -> None:
        """End the thread; the loop then takes its supervisor for lost."""
        self._stopped.set()
        self._thread.join()

    def tick(self, now_ns: int) -> None:
        """Report that the event loop is alive; call it from there."""
        self._ticked_ns = now_ns

    def beat_for(self, loop: LoopConnection) -> None:
        """Beat for another loop from now on."""
        self._loop = loop

    def beat(self, now_ns: int) -> None:
        """Beat if the event loop has ticked recently."""
        # Without the tick, this thread would beat for a supervisor whose event loop hangs.
        if now_ns - self._ticked_ns < s_to_ns(BUSY_S):
            self._loop.beat(now_ns)

    def _run(self) -> None:
        while not self._stopped.wait(BEAT_S):
            self.beat(time.monotonic_ns())
