"""Locks: one daemon for each stage, one process with its devices. Only the standard library."""

import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, Self

from piezod.errors import AlreadyRunningError, naming

POLL_S: Final = 0.05
_RUNS: Final = (
    "this stage is already running, as process {holder}; stop that first, or give the other "
    "stage's file another name"
)
_DRIVES: Final = (
    "process {holder} has the devices of this stage and drives them to their safe voltage, or "
    "hangs; wait, or end it by `kill -9 {holder}`, then `piezod safe`"
)


class Lock:
    """The lock of a stage, held from construction until `release` or the end of the process.

    It is taken before anything else of the stage is touched. The file stays after the release: to
    remove it could remove a file that another process has just locked.

    Args:
        path: The file; its folder must exist.
        refusal: Message if another process, `{holder}`, has it.

    Raises:
        AlreadyRunningError: If another process holds it; the text names that process.
        OSError: If the file cannot be opened.
    """

    def __init__(self, path: Path, refusal: str = _RUNS) -> None:
        self._path, self._refusal = path, refusal
        self._file = -1
        self.take()

    def take(self) -> None:
        """Take the lock, also again after a release.

        Raises:
            AlreadyRunningError: If another process holds it; the text names that process.
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
            what = self._refusal.format(holder=holder or "(not known)")
            raise AlreadyRunningError(f"{self._path}: {what}") from error
        # Only now: if the lock is refused, the file must keep the process id of its holder.
        try:
            with naming(self._path):
                os.ftruncate(self._file, 0)
                os.pwrite(self._file, f"{os.getpid()}\n".encode(), 0)
        except OSError:
            self.release()
            raise

    def release(self) -> None:
        """Release the lock; a second release does nothing."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)

    def __enter__(self) -> Self:
        """Return the lock."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release it."""
        self.release()


def device_lock(path: Path) -> Lock:
    """Take the lock of the devices, which a loop keeps after the end of its supervisor.

    Raises:
        AlreadyRunningError: If another process holds it; the text names that process.
        OSError: If the file cannot be opened.
    """
    return Lock(path, _DRIVES)


def taken_within(take: Callable[[], Lock], within_s: float) -> Lock:
    """Take a lock; wait for it at most this time, in s.

    Raises:
        AlreadyRunningError: If another process holds it all the time.
        OSError: If the file cannot be opened.
    """
    end_s = time.monotonic() + within_s
    while True:
        try:
            return take()
        except AlreadyRunningError:
            if time.monotonic() > end_s:
                raise
            time.sleep(POLL_S)
