"""Compilation of all numeric kernels of piezod, and their cache on disk.

Why not plain `numba.njit(cache=True)`: its cache raises where it finds no folder to write to, uses
a kernel whose callee in another file has changed, and runs a damaged file. A daemon that drives a
stage must do none of this. numba has no public interface to its cache, so private classes of it are
used here, and nowhere else; `pyproject.toml` names the versions of numba that this is tested with.
"""

import hashlib
import inspect
import logging
import os
import pickle
import sys
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar, cast

# numba imports both where they are installed, the first for its version only: the loop has no use
# for them.
_ABSENT: Final = [name for name in ("scipy", "coverage") if name not in sys.modules]
sys.modules.update(dict.fromkeys(_ABSENT))  # type: ignore[arg-type] # None: it cannot be imported
import numba  # noqa: E402 - see above
from numba.core.caching import (  # noqa: E402 - see above
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
)
from numba.core.dispatcher import Dispatcher  # noqa: E402 - see above

for _name in _ABSENT:
    del sys.modules[_name]

_P = ParamSpec("_P")
_R = TypeVar("_R")

_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",  # a division by zero gives inf or NaN instead of an exception
    "forceinline": True,  # kernels are short: calls between them would cost more than their work
    "_nrt": False,  # no memory runtime, so no allocation and no reference counting
}
_REMEDY: Final = "set NUMBA_CACHE_DIR to a folder that this user may write to"
_EVERY: Final = 10
"""A line of progress for so many kernels."""
_DIGEST_BYTES: Final = 32

_log = logging.getLogger(__name__)


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a kernel with numba and cache it on disk, as far as there is a place for it.

    A kernel can neither allocate nor raise: numba's memory runtime is off, so that a kernel that
    allocates does not compile (reference counting alone would cost ten times the arithmetic), and
    divisions follow IEEE 754. Sums keep their order, so results are equal to the bit for single
    samples and for arrays. The first call of each kernel loads or compiles it; make that call
    before a loop becomes real-time.
    """
    kernel: Any = numba.njit(**_OPTIONS)(function)
    if isinstance(kernel, Dispatcher):  # under NUMBA_DISABLE_JIT it is the function itself
        # In place of numba's own, which raises where it finds no folder, or a damaged file.
        cast("Any", kernel)._cache = _cache_of(function)  # noqa: SLF001
    return cast("Callable[_P, _R]", kernel)


class _Notices:
    """What people are told: that kernels are being compiled, and what is wrong with the cache.

    Attributes:
        listeners: Each gets the number of kernels whose compilation has begun.
        count: That number.
    """

    def __init__(self) -> None:
        self.listeners: list[Callable[[int], None]] = []
        self.count, self._told = 0, False

    def compiling(self) -> None:
        """Count a kernel, and say so now and then."""
        self.count += 1
        if self.count == 1:
            _log.warning(
                "piezod: compiling the kernels for this processor; this takes up to a minute"
            )
        elif self.count % _EVERY == 0:
            _log.warning("piezod: compiling: %d kernels so far", self.count)
        for listener in self.listeners:
            listener(self.count)

    def bad_cache(self, what: str) -> None:
        """Say once in this process what is wrong with the cache."""
        if not self._told:
            self._told = True
            _log.warning("piezod: %s", what)


_notices = _Notices()


def compilations() -> int:
    """Return the number of kernels whose compilation this process has begun."""
    return _notices.count


def tell_compilations(listener: Callable[[int], None]) -> None:
    """Call this from now on with the number of kernels, whenever the compilation of one begins."""
    _notices.listeners.append(listener)


class _Sources:
    """The source of a kernel, and of all that its machine code contains."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        # Now: an upgrade may replace the file while the process runs.
        self.files = {_digest(inspect.getfile(function)), _digest(__file__)}

    def stamp(self) -> frozenset[Any]:
        """Return what makes a cached kernel stale: its file, this one, and what the kernel uses.

        numba checks only the file of the function itself. The machine code also contains its
        callees, so that after a change of another file the old callee would still run.
        """
        stamps: set[Any] = set()
        waiting, seen = [self], set[int]()
        while waiting:
            source = waiting.pop()
            if id(source) in seen:
                continue
            seen.add(id(source))
            stamps |= source.files
            function = source.function
            for name in function.__code__.co_names:
                used = function.__globals__.get(name)
                if isinstance(used, Dispatcher):
                    waiting.append(cast("Any", used)._cache.sources)  # noqa: SLF001 - one of ours
                elif isinstance(used, int | float):
                    stamps.add((name, used))
        return frozenset(stamps)


class _NoCache(NullCache):
    """The cache of a kernel where no folder can be written to."""

    def __init__(self, sources: _Sources) -> None:
        self.sources = sources

    def load_overload(self, sig: Any, target_context: Any) -> None:  # noqa: ARG002 - numba's
        """Find nothing."""
        _notices.compiling()


class _Files(IndexDataCacheFile):
    """The files of a kernel, of which only those are used that are whole and belong to it.

    Each data file has its key, the stamp of its sources and a digest. numba's own has none of them:
    a write that ended half-way, or two processes at a time, can leave an index that names the
    machine code of another version or signature; and code with a wrong bit is executed.
    """

    def load(self, key: Any) -> Any:
        """Return the content of a kernel's file, or None."""
        data_name = self._load_index().get(key)
        if data_name is None:
            return None
        try:
            return self._content(Path(self._data_path(data_name)).read_bytes(), key)
        except FileNotFoundError:
            return None
        except Exception as error:  # noqa: BLE001 - see `_load_index`
            self._tell(data_name, error)
            return None

    def save(self, key: Any, data: Any) -> None:
        """Write the file of a kernel, and name it in the index."""
        super().save(key, (key, self._source_stamp, data))

    def _content(self, file: bytes, key: Any) -> Any:
        digest, rest = file[:_DIGEST_BYTES], file[_DIGEST_BYTES:]
        if hashlib.sha256(rest).digest() != digest:
            raise ValueError("it is damaged")
        found_key, stamp, data = pickle.loads(rest)  # noqa: S301 - of this user, as the code is
        return data if (found_key, stamp) == (key, self._source_stamp) else None

    def _save_data(self, name: str, data: Any) -> None:
        file = self._dump(data)
        with self._open_for_write(self._data_path(name)) as stream:
            stream.write(hashlib.sha256(file).digest() + file)

    def _load_index(self) -> dict[Any, str]:
        try:
            return dict(super()._load_index())
        except Exception as error:  # noqa: BLE001 - unpickling damaged bytes can raise anything
            self._tell(self._index_name, error)
            return {}

    def _tell(self, name: str, error: Exception) -> None:
        _notices.bad_cache(
            f"{Path(self._cache_path, name)}: this file of the cache of compiled kernels cannot be "
            f"used ({error!r}); the kernel is compiled again"
        )


class _Places(CompileResultCacheImpl):
    """Where numba looks for a folder for the cache."""

    # Without a home, its folder of the user would be a folder "~" where the process was started.
    if os.path.expanduser("~") == "~":  # noqa: PTH111 - pathlib raises
        _locator_classes = [
            place
            for place in CompileResultCacheImpl._locator_classes  # noqa: SLF001 - no public list
            if "UserWide" not in place.__name__  # older versions of numba have an underscore
        ]


class _Cache(FunctionCache):
    """The cache of a kernel; whatever is wrong with it is a miss."""

    _impl_class = _Places

    def __init__(self, function: Callable[..., Any], sources: _Sources) -> None:
        super().__init__(function)
        self.sources = sources
        del self._cache_file  # numba's

    @cached_property
    def _cache_file(self) -> _Files:  # type: ignore[override] # numba makes it at once
        # Now: what the kernel uses may be defined below it.
        return _Files(self._cache_path, self._impl.filename_base, self.sources.stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a kernel from the cache; None if it has to be compiled."""
        found = None
        try:
            # numba's `load_overload` would first import all that a compilation needs: 0.2 s, 30 MB.
            found = self._load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001 - of another version of LLVM, for example
            self._tell("be used", error)
        if found is None:
            _notices.compiling()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write a kernel to the cache, if that is possible."""
        try:
            super().save_overload(sig, data)
        except Exception as error:  # noqa: BLE001 - a full disk, a folder made read-only
            self._tell("be written", error)

    def _tell(self, what: str, error: Exception) -> None:
        _notices.bad_cache(
            f"{self._cache_path}: the cache of compiled kernels cannot {what} ({error}); the next "
            f"start compiles them again: {_REMEDY}"
        )


def _cache_of(function: Callable[..., Any]) -> _Cache | _NoCache:
    sources = _Sources(function)
    try:
        return _Cache(function, sources)
    except Exception as error:  # noqa: BLE001 - no home, no entry of this user, nowhere to write
        _notices.bad_cache(
            "no folder for the cache of compiled kernels can be written to; each start compiles "
            f"them, which takes up to a minute: {_REMEDY} ({error})"
        )
        return _NoCache(sources)


def _digest(file: str) -> bytes:
    return hashlib.sha256(Path(file).read_bytes()).digest()
