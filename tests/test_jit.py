"""Abilities and limits of compiled kernels, and when they are compiled again."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba.core.errors import NumbaError

from piezod.jit import compiled

CALLEE = """
from piezod.jit import compiled
OFFSET = {offset}
@compiled
def inner(x):
    return {factor} * x
"""
CALLER = """
from kernel_callee import OFFSET, inner
from piezod.jit import compiled
@compiled
def outer(x):
    return below(x)
@compiled
def below(x):
    return inner(x) + OFFSET
"""


def test_kernel_that_allocates_does_not_compile() -> None:
    """Numba's memory runtime is off, so an array made inside a kernel is an error."""

    def allocate(size: int) -> float:
        return float(np.zeros(size)[0])

    assert allocate(3) == 0.0
    with pytest.raises(NumbaError, match="No implementation of function"):
        compiled(allocate)(3)


def test_kernel_divides_as_the_standard_says() -> None:
    """A division by zero gives infinity or NaN; a kernel raises nothing."""

    @compiled
    def ratio(a: float, b: float) -> float:
        return a / b

    assert (ratio(1.0, 0.0), ratio(-1.0, 0.0)) == (float("inf"), float("-inf"))
    assert np.isnan(ratio(0.0, 0.0))


def load(folder: Path, *, factor: float, offset: float) -> ModuleType:
    """Write two modules, one using the other, and import them as a new process would."""
    (folder / "kernel_callee.py").write_text(CALLEE.format(factor=factor, offset=offset))
    (folder / "kernel_caller.py").write_text(CALLER)
    for name in ("kernel_callee", "kernel_caller"):
        sys.modules.pop(name, None)
    importlib.invalidate_caches()
    return importlib.import_module("kernel_caller")


def test_kernel_is_compiled_anew_when_what_it_is_built_on_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cached kernel follows a change of a callee, or of a constant, however far from it."""
    monkeypatch.syspath_prepend(tmp_path)

    assert load(tmp_path, factor=2.0, offset=1.0).outer(3.0) == 7.0
    assert load(tmp_path, factor=10.0, offset=1.0).outer(3.0) == 31.0
    assert load(tmp_path, factor=10.0, offset=1.25).outer(3.0) == 31.25


def test_kernel_that_did_not_change_is_loaded_from_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second process compiles nothing."""
    monkeypatch.syspath_prepend(tmp_path)
    load(tmp_path, factor=2.0, offset=1.0).outer(3.0)

    again = load(tmp_path, factor=2.0, offset=1.0)
    again.outer(3.0)

    assert sum(again.outer.stats.cache_hits.values()) == 1
