"""The supervisor's beat, by which the loop sees that it lives."""

import threading
import time
from typing import Final

from piezod.daemon.supervisor.connection import LoopConnection
from piezod.units import s_to_ns

BEAT_S: Final = 0.1
"""How often it beats; the loop takes a supervisor for dead after 1 s."""
BUSY_S: Final = 3.0
"""For how long the event loop may have no time before the beat stops: a supervisor that hangs is
found by that. As long as systemd's watchdog waits."""


class Heart:
    """Beats beside the event loop, which may be busy for a while, and stops where that hangs.

    Args:
        loop: The loop that is to see it.
    """

    def __init__(self, loop: LoopConnection) -> None:
        self._loop = loop
        self._ticked_ns = 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heart", daemon=True)

    def start(self) -> None:
        """Begin to beat; once."""
        self.tick(time.monotonic_ns())
        self._thread.start()

    def stop(self) -> None:
        """End, so that the loop sees nobody any more."""
        self._stopped.set()
        self._thread.join()

    def tick(self, now_ns: int) -> None:
        """Note that the event loop goes on; to be called from there."""
        self._ticked_ns = now_ns

    def beat_for(self, loop: LoopConnection) -> None:
        """Beat for another loop from now on."""
        self._loop = loop

    def beat(self, now_ns: int) -> None:
        """Beat, where the event loop has gone on lately."""
        if now_ns - self._ticked_ns < s_to_ns(BUSY_S):
            self._loop.beat(now_ns)

    def _run(self) -> None:
        while not self._stopped.wait(BEAT_S):
            self.beat(time.monotonic_ns())
