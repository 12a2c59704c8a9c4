"""The one way piezod compiles its numeric kernels."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core.dispatcher import Dispatcher

_P = ParamSpec("_P")
_R = TypeVar("_R")

_OPTIONS: dict[str, Any] = {
    "cache": True,
    "error_model": "numpy",
    "forceinline": True,
    "_nrt": False,
}


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a kernel with numba and cache it on disk.

    A kernel can neither allocate nor raise: numba's memory runtime is off (one that tries does not
    compile; reference counting alone would cost ten times the arithmetic), and divisions follow
    IEEE 754. Sums keep their order, so a result is the same to the bit whether it was computed
    sample by sample or over an array. The first call of each kernel loads or compiles it: make it
    before a loop turns real-time.
    """
    kernel: Any = numba.njit(**_OPTIONS)(function)
    if isinstance(kernel, Dispatcher):  # under NUMBA_DISABLE_JIT it is the function itself
        _stamp_with_callees(kernel, function)
    return cast("Callable[_P, _R]", kernel)


def _stamp_with_callees(kernel: Any, function: Callable[..., Any]) -> None:
    """Make a cached kernel stale when a kernel or a constant that it is built on changes.

    numba compares the file of the function alone. The callees are in the machine code too, so that
    without this an edit or an upgrade of another file would go on running the old one.
    """
    cache_file = _cache_file(kernel)
    stamps = {cache_file._source_stamp}  # noqa: SLF001 - as below
    for name in function.__code__.co_names:
        used = function.__globals__.get(name)
        if isinstance(used, Dispatcher):
            stamps |= _cache_file(used)._source_stamp  # noqa: SLF001
        elif isinstance(used, int | float):
            stamps.add((name, used))
    cache_file._source_stamp = frozenset(stamps)  # noqa: SLF001


def _cache_file(kernel: Any) -> Any:
    return kernel._cache._cache_file  # noqa: SLF001 - numba has no public way to the stamp
