"""Virtual time for a whole daemon in one process: clocks, and an event loop that never waits."""

import asyncio
import selectors
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from math import ceil
from typing import Any, ParamSpec, TypeVar
from unittest.mock import patch

from piezod.units import NS_PER_S

P = ParamSpec("P")
T = TypeVar("T")
START_NS = 1_000 * NS_PER_S
WALL_OFFSET_NS = 1_800_000_000 * NS_PER_S
_REAL_CLOCK_NS = time.clock_gettime_ns


class VirtualClock:
    """The clocks of a machine; they stand still unless something sleeps.

    Attributes:
        t_ns: CLOCK_MONOTONIC.
        wall_offset_ns: CLOCK_REALTIME minus CLOCK_MONOTONIC.
        boot_offset_ns: CLOCK_BOOTTIME minus CLOCK_MONOTONIC.
    """

    def __init__(self) -> None:
        self.t_ns = START_NS
        self.wall_offset_ns, self.boot_offset_ns = WALL_OFFSET_NS, 0

    def now_ns(self) -> int:
        """Return CLOCK_MONOTONIC."""
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Advance to an instant."""
        self.t_ns = max(self.t_ns, t_ns)

    @property
    def elapsed_s(self) -> float:
        """Time since the start, in s."""
        return (self.t_ns - START_NS) / NS_PER_S

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Replace the clocks of the module `time` in this process while the block runs.

        Raises:
            RuntimeError: If other threads run: they would wait until the real clock has reached the
                virtual one.
        """
        if threading.active_count() > 1:
            names = ", ".join(thread.name for thread in threading.enumerate())
            raise RuntimeError(f"other threads run: {names}; use a process of its own")
        replaced: dict[str, Callable[..., float]] = {
            "monotonic_ns": self.now_ns,
            "monotonic": lambda: self.t_ns / NS_PER_S,
            "time_ns": lambda: self.t_ns + self.wall_offset_ns,
            "time": lambda: (self.t_ns + self.wall_offset_ns) / NS_PER_S,
            "clock_gettime_ns": self._clock_gettime_ns,
        }
        with ExitStack() as stack:
            for name, function in replaced.items():
                stack.enter_context(patch.object(time, name, function))
            yield

    def _clock_gettime_ns(self, which: int) -> int:
        # The processor time of this process is real in any case.
        boot = which == time.CLOCK_BOOTTIME
        return self.t_ns + self.boot_offset_ns if boot else _REAL_CLOCK_NS(which)


class _Selector(selectors.DefaultSelector):
    """Serves sockets at once; lets virtual time pass if there is nothing to serve."""

    def __init__(self, pass_ns: Callable[[int | None], None]) -> None:
        super().__init__()
        self._pass_ns = pass_ns

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return what is ready; after a virtual wait that is nothing."""
        ready = super().select(0)
        if not ready and (timeout is None or timeout > 0):
            self._pass_ns(None if timeout is None else ceil(timeout * NS_PER_S))
        return ready


class AtOnce(ThreadPoolExecutor):
    """Runs each call in the thread that submits it: no virtual time passes meanwhile."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> "Future[T]":
        """Call the function; return its result or exception."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - raised where the future is awaited
            future.set_exception(error)
        return future


def run_virtually(main: Coroutine[Any, Any, T], pass_ns: Callable[[int | None], None]) -> T:
    """Run a coroutine like `asyncio.run`.

    `pass_ns` lets at most a time pass, in ns, or any time if that is None.
    """

    def make() -> asyncio.AbstractEventLoop:
        loop = asyncio.SelectorEventLoop(_Selector(pass_ns))
        loop.set_default_executor(AtOnce(1))
        return loop

    with asyncio.Runner(loop_factory=make) as runner:
        return runner.run(main)
