"""The one way piezod compiles its numeric kernels."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

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
    return cast("Callable[_P, _R]", numba.njit(**_OPTIONS)(function))
