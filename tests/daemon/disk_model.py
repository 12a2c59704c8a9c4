"""A model of a disk: the files that may be found after a power failure.

`LoggingOs` replaces the module `os` and logs the operations on files. `crash_states` yields every
folder that a power failure at the end of such a log may leave. A name that was not synced may be
there or not; contents that were not synced may be complete, truncated, zero or missing.
"""

import os
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

Folder = dict[str, bytes]


class Op(NamedTuple):
    """An operation: "write", "sync", "rename" or "sync-folder"."""

    kind: str  #: Its kind.
    name: str = ""  #: Name of the file.
    to: str = ""  #: New name.
    content: bytes = b""  #: The bytes that were written.


class LoggingOs:
    """The module `os`, with a log of the operations on files."""

    def __init__(self) -> None:
        self.log: list[Op] = []
        self._names: dict[int, str] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        descriptor = os.open(path, flags, mode)
        self._names[descriptor] = "" if flags & os.O_DIRECTORY else path.name
        return descriptor

    def write(self, descriptor: int, data: memoryview) -> int:
        written = os.write(descriptor, data)
        self.log.append(Op("write", self._names[descriptor], content=bytes(data[:written])))
        return written

    def fsync(self, descriptor: int) -> None:
        name = self._names[descriptor]
        self.log.append(Op("sync", name) if name else Op("sync-folder"))

    def rename(self, path: Path, to: Path) -> None:
        self.log.append(Op("rename", path.name, to.name))
        path.rename(to)


def crash_states(before: Folder, log: list[Op]) -> Iterator[Folder]:
    """Yield every folder that may be found after a power failure at the end of a log."""
    written: dict[str, bytes] = {}
    synced: set[str] = set()
    renamed: list[tuple[str, str, bool]] = []
    for op in log:
        if op.kind == "write":
            written[op.name] = written.get(op.name, b"") + op.content
        elif op.kind == "sync":
            synced.add(op.name)
        elif op.kind == "rename":
            renamed.append((op.name, op.to, False))
        else:
            renamed = [(name, to, True) for name, to, _ in renamed]
    for choice in product(*(_states_of(*each, written, synced) for each in renamed)):
        yield before | {name: content for state in choice for name, content in state.items()}


def _states_of(
    name: str, to: str, name_synced: bool, written: dict[str, bytes], synced: set[str]
) -> list[Folder]:
    content = written[name]
    found = [content]
    if name not in synced:
        found += [b"", content[: len(content) // 2], bytes(len(content))]
    # If the new name has not reached the disk, the temporary one may be there, or neither.
    without: list[Folder] = [] if name_synced else [{}, *({name: each} for each in found)]
    return [{to: each} for each in found] + without
