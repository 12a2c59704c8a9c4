"""The audit log: who asked for what, and the answer; JSON lines that are only appended."""

import errno
import json
import os
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from itertools import chain, islice
from pathlib import Path
from typing import Final

from piezod.daemon.logging import logger
from piezod.messages.stores import AuditLine
from piezod.own_folder import make_folder

MAX_BYTES: Final = 4 << 20
"""Largest size of a file; then a new one is begun."""
KEPT: Final = 5
"""Number of files that are kept, including the present one."""

_MAX_TEXT: Final = 1000


def _utc_now() -> datetime:
    return datetime.now(UTC)


class AuditLog:
    """Appends entries to a file; a full disk loses entries, but never refuses a request.

    For one thread, except that `sync` and `last` may run in another one at the same time.

    Args:
        path: The file, made if it is absent; older files have the suffix `.1`, `.2`, ….
        now: The time of day.
        max_bytes: Largest size of a file.

    Raises:
        OSError: If the file cannot be opened.
    """

    def __init__(
        self,
        path: Path,
        now: Callable[[], datetime] = _utc_now,
        max_bytes: int = MAX_BYTES,
    ) -> None:
        make_folder(path.parent, 0o750)
        self._path, self._now, self._max_bytes = path, now, max_bytes
        self._descriptor = _open(path)
        self._size = os.fstat(self._descriptor).st_size
        # If the last line was cut off, the next entry must still begin a line of its own.
        self._torn = self._size > 0 and _last_byte(path) != b"\n"
        self.failed = 0
        """Number of entries that could not be written."""

    def write(
        self,
        uid: int,
        user: str,
        client: str,
        what: str,
        accepted: bool,
        why: str = "",
        when: datetime | None = None,
    ) -> None:
        """Append an entry; it survives the end of this process, and a power failure after `sync`.

        Texts are cut at 1000 characters.

        Args:
            uid: User id of the client.
            user: Name of that user.
            client: Name that the client gives itself.
            what: The request.
            accepted: Whether it is accepted.
            why: Why not.
            when: Time of the request; None for the present.
        """
        at = (when or self._now()).isoformat(timespec="milliseconds")
        user, client, what, why = (text[:_MAX_TEXT] for text in (user, client, what, why))
        entry = AuditLine(at, uid, user, client, what, accepted, why)
        line = (json.dumps(vars(entry)) + "\n").encode()
        try:
            self._append(line)
        except OSError as error:
            if not self.failed:  # a full disk would fill the log too
                logger("audit").error("audit entry lost", file=str(self._path), why=error.strerror)
            self.failed += 1

    def last(self, number: int) -> tuple[AuditLine, ...]:
        """Return the newest entries of the present file and the one before, newest first.

        Raises:
            OSError: If the file cannot be read.
        """
        lines = chain(_lines_backwards(self._path), _lines_backwards(self._older(1)))
        return tuple(islice(filter(None, map(_entry, lines)), number))

    def sync(self) -> None:
        """Bring the entries to the disk; may block, so call it in a worker thread."""
        try:
            # A descriptor of its own, because `write` may begin a new file meanwhile.
            descriptor = _open(self._path)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        except OSError as error:
            logger("audit").error("audit not synced", file=str(self._path), why=error.strerror)

    def close(self) -> None:
        """Sync and close the file; call it once."""
        self.sync()
        os.close(self._descriptor)

    def _append(self, line: bytes) -> None:
        if self._size and self._size + len(line) > self._max_bytes:
            self._rotate()
        if self._torn:
            line = b"\n" + line
        # One write per line, so that lines never mix.
        written = os.write(self._descriptor, line)
        self._size += written
        self._torn = written < len(line)
        if self._torn:
            raise OSError(0, "the disk took only a part of the entry")

    def _rotate(self) -> None:
        for number in range(KEPT - 1, 0, -1):
            newer = self._older(number - 1) if number > 1 else self._path
            if newer.exists():
                newer.replace(self._older(number))
        descriptor = _open(self._path)  # before the old one is closed: if this fails, it stays
        os.close(self._descriptor)
        self._descriptor, self._size, self._torn = descriptor, 0, False

    def _older(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}")


def _open(path: Path) -> int:
    # Checked before: opening a named pipe would wait for a reader.
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "must be a regular file; remove it", str(path))
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    return os.open(path, flags, 0o640)


def _lines_backwards(path: Path) -> Iterator[bytes]:
    if path.exists():
        yield from reversed(path.read_bytes().splitlines())


def _last_byte(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1)


def _entry(line: bytes) -> AuditLine | None:
    try:
        return AuditLine(**json.loads(line))
    except (ValueError, TypeError):  # cut off by a power failure
        return None
