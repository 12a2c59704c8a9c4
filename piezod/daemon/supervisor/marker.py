"""The mark of a running stage: if a start finds it, the last run did not end in order."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

from piezod.errors import DataError, naming
from piezod.given_file import open_given

_HUNG: Final = b"hung\n"
_MOST_BYTES: Final = 4096
_FLAGS: Final = os.O_WRONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
"""Neither a link is followed nor a reader of a named pipe awaited."""


class Marker:
    """A file that exists from the start of a run until its orderly end.

    Args:
        path: The file; its folder must exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.unclean = os.path.lexists(path)  # a link is not followed
        """Whether the run before this one did not end in order."""
        self.hung = False
        """Whether its loop was killed because it hung."""
        with suppress(OSError, DataError), open_given(path, _MOST_BYTES, follow=False) as file:
            self.hung = file.read().endswith(_HUNG)

    def put(self) -> None:
        """Make the file, so that it survives a power failure.

        Raises:
            OSError: If that fails.
        """
        file = os.open(self._path, _FLAGS | os.O_CREAT, 0o600)
        try:
            with naming(self._path):
                os.ftruncate(file, 0)
                os.write(file, f"{os.getpid()}\n".encode())
                os.fsync(file)
        except OSError:
            if not self.unclean:
                self._path.unlink()
            raise
        finally:
            os.close(file)
        self._sync_folder()  # the content alone would be lost with its name

    def note_hung(self) -> None:
        """Note for the next run that the loop of this one hung; without room, that is lost."""
        with suppress(OSError):
            file = os.open(self._path, _FLAGS | os.O_APPEND | os.O_CREAT, 0o600)
            try:
                os.write(file, _HUNG)
                os.fsync(file)
            finally:
                os.close(file)

    def remove(self) -> None:
        """Remove the file: the run has ended in order.

        Raises:
            OSError: If that fails.
        """
        self._path.unlink(missing_ok=True)
        self._sync_folder()

    def _sync_folder(self) -> None:
        folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
