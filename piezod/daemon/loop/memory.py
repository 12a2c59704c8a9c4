"""Locks the memory of the loop process in RAM, except the parts that no cycle uses.

The compiler (LLVM, 150 MB) and OpenBLAS (25 MB) have done their work before the loop runs: a cycle
has kernels, and no products of matrices. OpenBLAS also reserves memory for products of large ones,
in pieces of 32 MB. `mlockall` alone would bring all of that into RAM.
"""

import ctypes
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_MADV_DONTNEED: Final = 4
_DONE: Final = ("llvm", "openblas", "gfortran", "quadmath")
"""The libraries that a cycle does not use; the last two belong to OpenBLAS."""
_RESERVED_KB, _USED_KB = 32 << 10, 1 << 10
"""Memory of this size with less than that in RAM, in KiB, is reserved by OpenBLAS: no buffer of a
cycle is as large. The pages that it has used stay locked."""

_MAPPING: Final = re.compile(
    r"^(?P<begin>[0-9a-f]+)-(?P<end>[0-9a-f]+) (?P<access>\S+) \S+ \S+ \S+ *(?P<file>.*)\n"
    r"(?:.*\n)*?Rss: +(?P<resident>\d+) kB\n"
    r"(?:.*\n)*?Anonymous: +(?P<changed>\d+) kB\n",
    re.MULTILINE,
)
"""One mapping in /proc/self/smaps."""


class Mapping(NamedTuple):
    """A part of the address space of this process."""

    begin: int  #: Its first address.
    size: int  #: Its size, in bytes.
    readable: bool  #: Whether this process may read it.
    file: str  #: Path of the mapped file; empty without one.
    resident_kb: int  #: Size of the part in RAM, in KiB.
    changed_kb: int  #: Size of the part in RAM that differs from the file, in KiB.


def lock_memory(libc: ctypes.CDLL) -> None:
    """Lock present and future memory, and bring the present memory of the cycle into RAM.

    Args:
        libc: The C library, loaded with `use_errno`.

    Raises:
        OSError: If the kernel refuses; nothing is locked then.
    """
    # On fault at first, so that the kernel does not read the compiler from the disk.
    if libc.mlockall(_MCL_CURRENT | _MCL_ONFAULT) != 0:
        raise _refused()
    for each in mappings():
        address, size = ctypes.c_void_p(each.begin), ctypes.c_size_t(each.size)
        if _is_done(each):
            libc.munlock(address, size)
            # It is unchanged: if the library is used again, it comes from the file again.
            libc.madvise(address, size, _MADV_DONTNEED)
        elif each.readable and not _is_reserved(each):
            # An error is that of a page behind the end of its file, which `mlockall` ignores too.
            libc.mlock(address, size)
    if libc.mlockall(_MCL_FUTURE) != 0:
        raise _refused()


def _refused() -> OSError:
    error = ctypes.get_errno()
    return OSError(error, f"{os.strerror(error)}; allow it by LimitMEMLOCK=infinity")


def _is_done(each: Mapping) -> bool:
    """Return whether a mapping is code or constants of a library that no cycle uses."""
    name = Path(each.file).name
    return not each.changed_kb and any(library in name for library in _DONE)


def _is_reserved(each: Mapping) -> bool:
    large = not each.file and each.size >= _RESERVED_KB << 10
    return large and each.resident_kb < _USED_KB


def mappings() -> Iterator[Mapping]:
    """Yield the mappings of this process, in the order of their addresses."""
    text = Path("/proc/self/smaps").read_text(encoding="utf-8", errors="replace")
    for found in _MAPPING.finditer(text):
        begin, end = (int(found[name], 16) for name in ("begin", "end"))
        yield Mapping(
            begin,
            end - begin,
            found["access"].startswith("r"),
            found["file"],
            int(found["resident"]),
            int(found["changed"]),
        )
