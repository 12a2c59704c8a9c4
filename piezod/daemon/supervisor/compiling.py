"""What the service manager is told while a loop process compiles its kernels."""

from typing import Final

from piezod.daemon.supervisor.loop_run import LoopRun
from piezod.daemon.supervisor.notify import Notifier
from piezod.telemetry.words import Word

_WITHIN_S: Final = 60.0
"""How long one kernel may take to compile, in s; on a free processor it takes less than one."""


class CompilingReport:
    """Tells the manager how far a loop is; each kernel gives the start more time.

    Args:
        notifier: Reports to the service manager.
    """

    def __init__(self, notifier: Notifier) -> None:
        self._notifier, self._compiled = notifier, 0

    def update(self, run: LoopRun) -> None:
        """Report a change; a loop that takes requests has compiled everything."""
        compiled = run.loop.shared.words[Word.COMPILED_KERNELS]
        if compiled != self._compiled and not run.takes_requests:
            self._compiled = compiled
            status = f"compiling the kernels for this processor: {compiled} so far"
            self._notifier.take_longer(_WITHIN_S, status)
