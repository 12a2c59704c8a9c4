"""Runs the thread of a play in virtual time: it and the loop take turns, the same in every run."""

import threading
from math import inf

from piezod.daemon.loop.play_thread import _PlayThread
from piezod.units import s_to_ns
from tests.soak.virtual_time import VirtualClock


class LockStep:
    """Lets one thread at a time run beside the main thread, between two of its sleeps.

    At `due_ns` the thread goes on; it is infinite without one.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._go, self._rests = threading.Semaphore(0), threading.Semaphore(0)
        self._thread: threading.Thread | None = None
        self._killed = False
        self.due_ns: float = inf

    def begin(self, thread: threading.Thread) -> None:
        """Take a thread that has started; return when it sleeps."""
        self._thread, self._killed = thread, False
        self._rests.acquire()

    def sleep(self, duration_s: float) -> None:
        """Let virtual time pass; the thread calls this."""
        self.due_ns = self._clock.t_ns + s_to_ns(duration_s)
        self._rests.release()
        self._go.acquire()
        if self._killed:
            raise SystemExit

    def end(self) -> None:
        """Take the end of the thread, which calls this last."""
        self.due_ns = inf
        self._rests.release()

    def run(self) -> None:
        """Let the thread run to its next sleep, or to its end."""
        self._go.release()
        self._rests.acquire()
        if self.due_ns == inf and self._thread is not None:
            self._thread.join()
            self._thread = None

    def kill(self) -> None:
        """End the thread where it sleeps, as the end of its process does."""
        if self._thread is not None:
            self._killed = True
            self.run()


class _SteppedEvent(threading.Event):
    """An event that is waited for in virtual time."""

    def __init__(self, steps: LockStep) -> None:
        super().__init__()
        self._steps = steps

    def wait(self, timeout: float | None = None) -> bool:
        """Sleep, unless it is set; return whether it is."""
        if not self.is_set() and timeout is not None:
            self._steps.sleep(timeout)
        return self.is_set()


class SteppedPlay(_PlayThread):
    """The thread of a play, in lock step."""

    def __init__(self, steps: LockStep, *given: object) -> None:
        super().__init__(*given)  # type: ignore[arg-type]
        self._steps, self.aborted = steps, _SteppedEvent(steps)

    def start(self) -> None:
        """Start, and run to the first sleep."""
        super().start()
        self._steps.begin(self)

    def run(self) -> None:
        """Play."""
        try:
            super().run()
        finally:
            self._steps.end()
