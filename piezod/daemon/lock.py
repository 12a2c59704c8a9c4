"""One daemon for each stage: a locked file; imports nothing but the standard library."""

import fcntl
import os
from pathlib import Path
from types import TracebackType
from typing import Self

from piezod.errors import AlreadyRunningError


class Lock:
    """The lock of a stage, held from construction until `release` or the end of the process.

    It is taken before anything else of the stage is touched. The file stays when it is released:
    whoever removed it could remove one that somebody else has just locked.

    Args:
        path: The file; its folder must exist.

    Raises:
        AlreadyRunningError: If somebody else holds it; the text names that process.
        OSError: If the file cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = -1
        self.take()

    def take(self) -> None:
        """Take it, again where it was released.

        Raises:
            AlreadyRunningError: If somebody else holds it; the text names that process.
            OSError: If the file cannot be opened.
        """
        # Not inherited by children: a loop process that outlives its supervisor must not keep
        # `piezod safe` from taking the lock.
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        self._file = os.open(self._path, flags, 0o600)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.pread(self._file, 32, 0).decode("ascii", "replace").strip()
            self.release()
            what = f"this stage is already running, as process {holder or '(not known)'}"
            raise AlreadyRunningError(
                f"{self._path}: {what}; stop that first, or give the other stage's file "
                "another name"
            ) from error
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"{os.getpid()}\n".encode(), 0)

    def release(self) -> None:
        """Let others take it; releasing twice does nothing."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)

    def __enter__(self) -> Self:
        """Return the lock."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Release it."""
        self.release()
