"""The file that loop and supervisor map into their memory: RUNTIME/loop.map.

The supervisor creates it before it starts the loop, and removes it. It is a file and not
`multiprocessing.shared_memory`, whose resource tracker unlinks segments under living readers before
Python 3.13. It stays mapped while a view of it exists; nothing needs to be closed.
"""

import json
import mmap
import os
from pathlib import Path
from typing import Any, Final

from piezod.errors import PiezodError, naming
from piezod.telemetry.layout import Layout
from piezod.telemetry.words import Word

_MAGIC: Final = int.from_bytes(b"piezodLM", "little")
_VERSION: Final = 2
_HEADER_WORDS: Final = 3
_TEXT_AT: Final = _HEADER_WORDS * 8


class MapError(PiezodError):
    """Raised when a file is not a shared memory of this version of piezod."""


class SharedMap:
    """The parts of a mapped file; built by `create` and `attach`.

    Args:
        memory: The mapped file.
        layout: Layout of its parts.
        path: The file.
    """

    def __init__(self, memory: mmap.mmap, layout: Layout, path: Path) -> None:
        self.layout, self.path = layout, path
        self._memory = memory
        self._parts = layout.parts()
        self.words = self.part("words").cast("q")
        """The words, indexed by `Word`."""

    def part(self, name: str) -> "memoryview[int]":
        """Return the bytes of a part of `Layout.parts`, without a copy."""
        return memoryview(self._memory)[self._parts[name]]

    def set_report(self, report: Any) -> None:
        """Publish once the real-time set-up that the loop obtained; at most 16 KiB of JSON."""
        text = json.dumps(report).encode()
        self.part("report")[: len(text)] = text
        self.words[Word.REPORT_BYTES] = len(text)

    def report(self) -> Any:
        """Return the report of `set_report`, None before it."""
        length = self.words[Word.REPORT_BYTES]
        return json.loads(bytes(self.part("report")[:length])) if length else None


def create(path: Path, layout: Layout) -> SharedMap:
    """Create the file, readable by its owner only, in place of one from an earlier run.

    It gets its name when it is complete.

    Raises:
        OSError: If it cannot be created; ENOSPC also if only its memory is missing.
    """
    unfinished = path.with_name(f"{path.name}.new")
    unfinished.unlink(missing_ok=True)
    file = os.open(unfinished, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    try:
        with naming(path):
            # Allocate the memory now: a sparse file would kill the loop when memory runs out later.
            os.posix_fallocate(file, 0, layout.size)
            memory = mmap.mmap(file, layout.size, mmap.MAP_SHARED)
    except OSError:
        unfinished.unlink()
        raise
    finally:
        os.close(file)
    text = layout.dump()
    memory[_TEXT_AT : _TEXT_AT + len(text)] = text
    header = memoryview(memory)[:_TEXT_AT].cast("q")
    header[0], header[1], header[2] = _MAGIC, _VERSION, len(text)
    unfinished.replace(path)
    return SharedMap(memory, layout, path)


def attach(path: Path, *, writable: bool = False) -> SharedMap:
    """Map a file that `create` has created.

    Args:
        path: The file.
        writable: Whether the caller writes; a reader cannot write even by mistake.

    Raises:
        OSError: If the file cannot be read.
        MapError: If it is another file, or one of another version of piezod.
    """
    flags = os.O_RDWR if writable else os.O_RDONLY
    file = os.open(path, flags | os.O_CLOEXEC | os.O_NOFOLLOW)
    try:
        size = os.fstat(file).st_size
        access = mmap.PROT_READ | (mmap.PROT_WRITE if writable else 0)
        memory = mmap.mmap(file, size, mmap.MAP_SHARED, access) if size else None
    finally:
        os.close(file)
    # The size must agree, too: a truncated file would end in SIGBUS at the first access.
    layout = _layout(memory) if memory else None
    if memory is None or layout is None or layout.size != size:
        raise MapError(
            f"{path} is not a shared memory of this version of piezod; restart the daemon"
        )
    return SharedMap(memory, layout, path)


def _layout(memory: mmap.mmap) -> Layout | None:
    if len(memory) < _TEXT_AT:
        return None
    magic, version, length = memoryview(memory)[:_TEXT_AT].cast("q")
    if (magic, version) != (_MAGIC, _VERSION):
        return None
    return Layout.load(memory[_TEXT_AT : _TEXT_AT + length])
