"""Compilation of all numeric kernels of piezod."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core.dispatcher import Dispatcher

_P = ParamSpec("_P")
_R = TypeVar("_R")

_OPTIONS: dict[str, Any] = {
    "cache": True,
    "error_model": "numpy",  # a division by zero gives inf or NaN instead of an exception
    "forceinline": True,  # kernels are short: calls between them would cost more than their work
    "_nrt": False,  # no memory runtime, so no allocation and no reference counting
}


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a kernel with numba and cache it on disk.

    A kernel can neither allocate nor raise: numba's memory runtime is off, so that a kernel that
    allocates does not compile (reference counting alone would cost ten times the arithmetic), and
    divisions follow IEEE 754. Sums keep their order, so results are equal to the bit for single
    samples and for arrays. The first call of each kernel loads or compiles it; make that call
    before a loop becomes real-time.
    """
    kernel: Any = numba.njit(**_OPTIONS)(function)
    if isinstance(kernel, Dispatcher):  # under NUMBA_DISABLE_JIT it is the function itself
        _stamp_with_callees(kernel, function)
    return cast("Callable[_P, _R]", kernel)


def _stamp_with_callees(kernel: Any, function: Callable[..., Any]) -> None:
    """Make a cached kernel stale if a kernel or a constant that it uses changes.

    numba checks only the file of the function itself. The machine code also contains its callees,
    so that after a change of another file the old callee would still run.
    """
    cache_file = _cache_file(kernel)
    stamps = {cache_file._source_stamp}  # noqa: SLF001 - see `_cache_file`
    for name in function.__code__.co_names:
        used = function.__globals__.get(name)
        if isinstance(used, Dispatcher):
            stamps |= _cache_file(used)._source_stamp  # noqa: SLF001
        elif isinstance(used, int | float):
            stamps.add((name, used))
    cache_file._source_stamp = frozenset(stamps)  # noqa: SLF001


def _cache_file(kernel: Any) -> Any:
    return kernel._cache._cache_file  # noqa: SLF001 - numba has no public way to the stamp
