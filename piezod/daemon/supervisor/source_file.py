"""The configuration file, which somebody may edit while its stage runs."""

from contextlib import suppress
from pathlib import Path
from stat import S_ISREG

from piezod.config.yaml_events import MAX_BYTES


class SourceFile:
    """Detects that a file has other contents than at first.

    Args:
        path: The file; it may be absent.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamp, self._text = self._stamp_now(), self._text_now()
        self._changed = False

    def changed(self) -> bool:
        """Return whether the contents have changed; the file is read only if its stamp has."""
        stamp = self._stamp_now()
        if stamp != self._stamp:
            self._stamp, self._changed = stamp, self._text_now() != self._text
        return self._changed

    def _stamp_now(self) -> tuple[int, ...]:
        """Return what changes with the contents; empty if there is no such file."""
        with suppress(OSError):
            found = self._path.stat()
            if S_ISREG(found.st_mode):  # anything else might wait for a writer
                return found.st_mtime_ns, found.st_size, found.st_ino
        return ()

    def _text_now(self) -> bytes:
        """Return the contents, as far as they can be a configuration; empty without a file."""
        if self._stamp_now():
            with suppress(OSError), self._path.open("rb") as file:
                return file.read(MAX_BYTES + 1)
        return b""
