"""Asks the operating system for real time, in an order in which no step undoes another.

Call it when everything is imported, compiled, opened and used once. Each step reports what it
obtained, and none of them raises: a loop without them runs too, but is late more often.
"""

import ctypes
import gc
import os
import struct
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from piezod.config.daemon import LoopConfig
from piezod.daemon.loop.memory import lock_memory
from piezod.daemon.loop.processor import ClaimedProcessor, claim_processor
from piezod.daemon.loop.rate import throttle_part
from piezod.telemetry.layout import PAGE
from piezod.telemetry.shared_map import SharedMap

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_KEEP_BYTES: Final = 1 << 30
_MMAP_BYTES: Final = 32 << 20  # the largest value that glibc accepts
_PR_SET_TIMERSLACK: Final = 29
_THREAD_CHECKS: Final = 100
_OWN_PARTS: Final = ("answers", "learned", "events", "ring")
"""The parts of the shared memory that the loop process writes."""
LEAST_THROTTLE: Final = 0.5
"""With less than this part of the time, no loop keeps the rate that its cycle allows."""
_ROOM: Final = "room in each second"
_DMA_LATENCY: Final = Path("/dev/cpu_dma_latency")


class RealtimeStep(NamedTuple):
    """One request to the operating system."""

    name: str  #: Its name.
    wanted: str  #: The requested value.
    obtained: str  #: The present value, or why it differs from the requested one, with the remedy.
    ok: bool  #: Whether it is the requested value.


class Realtime:
    """Makes the requests, and holds what must be held until the process ends.

    Args:
        config: Priority and processor.
        shared: The shared memory, writable.
        threads: Expected number of threads: the loop, and those that use devices.
    """

    def __init__(self, config: LoopConfig, shared: SharedMap, threads: int = 1) -> None:
        self._config, self._shared, self._wanted_threads = config, shared, threads
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._latency_file: int | None = None
        self.processor: ClaimedProcessor | None = None
        """The processor of the loop; None before `set_up`, or if the system refused it."""

    def set_up(self) -> list[RealtimeStep]:
        """Make all requests; return their results."""
        chosen = claim_processor(self._config.cpu, os.sched_getaffinity(0))
        steps: tuple[tuple[str, str, Callable[[], str]], ...] = (
            ("threads", str(self._wanted_threads), self._count_threads),
            ("heap", "kept", self._keep_heap),
            ("memory", "locked", self._lock_memory),
            ("shared memory", "in RAM, touched", self._touch_shared),
            ("cpu latency", "0 us", self._request_latency),
            ("timer slack", "1 ns", self._cut_timer_slack),
            ("garbage collection", "off", _stop_collecting),
            ("processor", str(chosen.cpu), partial(self._pin, chosen)),
            ("throttle", _ROOM, _throttle),
            ("scheduling", f"SCHED_FIFO {self._config.priority}", self._raise_priority),
        )
        return list(_carried_out(steps))

    def leave(self) -> None:
        """Become an ordinary process: ending takes long, and other loops need the processor."""
        # Keep the flag: only root may clear it.
        os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))

    def _count_threads(self) -> str:
        for _ in range(_THREAD_CHECKS):
            threads = len(list(Path("/proc/self/task").iterdir()))
            if threads <= self._wanted_threads:
                break
            time.sleep(0.001)  # the kernel may still list a thread that was joined
        return str(threads)

    def _keep_heap(self) -> str:
        # Before memory is locked: memory that malloc returns and takes again would have to be
        # locked and faulted in again, in the middle of a cycle.
        for option, value in (
            (_M_TRIM_THRESHOLD, _KEEP_BYTES),
            (_M_MMAP_THRESHOLD, _MMAP_BYTES),
        ):
            if not self._libc.mallopt(option, value):
                raise OSError(None, "mallopt refused; this C library does not know the option")
        return "kept"

    def _lock_memory(self) -> str:
        lock_memory(self._libc)
        return "locked"

    def _touch_shared(self) -> str:
        for name in _OWN_PARTS:
            part = self._shared.part(name)
            for at in range(0, len(part), PAGE):
                part[at] = part[at]
        return "in RAM, touched" if _in_ram(self._shared.path) else "touched, on a disk"

    def _request_latency(self) -> str:
        file = os.open(_DMA_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
        self._latency_file = file  # the request lasts as long as the file is open
        os.write(file, struct.pack("=i", 0))
        return "0 us"

    def _cut_timer_slack(self) -> str:
        if self._libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1)) != 0:
            raise OSError(ctypes.get_errno(), "prctl refused")
        return "1 ns"

    def _pin(self, chosen: ClaimedProcessor) -> str:
        try:
            os.sched_setaffinity(0, {chosen.cpu})
        except OSError:
            if chosen.mark is not None:
                chosen.mark.close()
            raise
        self.processor = chosen
        return str(chosen.cpu)

    def _raise_priority(self) -> str:
        # Last: a long task at this priority would starve other processes. Children are ordinary.
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(self._config.priority))
        return f"SCHED_FIFO {self._config.priority}"


def _carried_out(
    steps: tuple[tuple[str, str, Callable[[], str]], ...],
) -> Iterator[RealtimeStep]:
    for name, wanted, step in steps:
        try:
            obtained = step()
        except OSError as error:
            obtained = error.strerror or str(error)
            if isinstance(error, PermissionError) and "Limit" not in obtained:
                obtained += "; run as the service does, or as root"
        yield RealtimeStep(name, wanted, obtained, obtained == wanted)


def _throttle() -> str:
    """Return that the kernel leaves real-time threads enough of each second, or what it leaves."""
    part = throttle_part()
    if part > LEAST_THROTTLE:
        return _ROOM
    return f"{part:.0%} of each second: set kernel.sched_rt_runtime_us to 950000"


def _stop_collecting() -> str:
    # Frozen objects are never visited again, even if a library calls the collector.
    gc.collect()
    gc.freeze()
    gc.disable()
    return "off"


def _in_ram(path: Path) -> bool:
    """Return whether a file is on a tmpfs; elsewhere, writing to a page waits for the disk."""
    mounts = [line.split() for line in Path("/proc/self/mounts").read_text().splitlines()]
    resolved = path.resolve()
    under = [mount for mount in mounts if resolved.is_relative_to(mount[1])]
    return bool(under) and max(under, key=lambda mount: len(mount[1]))[2] in {"tmpfs", "ramfs"}
