"""Bounds of memory and time of a process, which the kernel keeps."""

import resource
import time
from contextlib import suppress


def bound(most_bytes: int, within_s: int) -> None:
    """Bound this process; call it again for more time.

    Args:
        most_bytes: Most address space that it may have, in bytes; beyond it raises MemoryError.
        within_s: Time of the processor that it has from now on, in s; then the kernel ends it.
    """
    _lower(resource.RLIMIT_AS, most_bytes)
    _lower(resource.RLIMIT_CPU, int(time.process_time()) + within_s)


def bound_other(process: int, most_bytes: int, within_s: int) -> None:
    """Bound a process that has just been started; one that has ended already is left alone.

    Args:
        process: Its number.
        most_bytes: Most address space that it may have, in bytes.
        within_s: Most time of the processor, in s.
    """
    for kind, most in ((resource.RLIMIT_AS, most_bytes), (resource.RLIMIT_CPU, within_s)):
        with suppress(ProcessLookupError):
            resource.prlimit(process, kind, (most, most))


def is_bounded() -> bool:
    """Return whether this process has such bounds, set by itself or by who has started it."""
    kinds = (resource.RLIMIT_AS, resource.RLIMIT_CPU)
    return all(resource.getrlimit(kind)[0] != resource.RLIM_INFINITY for kind in kinds)


def _lower(kind: int, wanted: int) -> None:
    _, hardest = resource.getrlimit(kind)
    if hardest != resource.RLIM_INFINITY:
        wanted = min(wanted, hardest)
    resource.setrlimit(kind, (wanted, hardest))
