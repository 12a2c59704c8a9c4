"""The configuration file and the files that it names, which somebody may edit meanwhile."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG

from piezod.config.files import digest


class SourceFiles:
    """Detects that a file has other contents than those that were read.

    Args:
        source: The configuration file, which nobody has read yet; it may be absent.
    """

    def __init__(self, source: Path) -> None:
        self._files = [_SourceFile(source, digest(source))]
        self.named: Mapping[str, str] = {}
        """Digest of each file that the configuration names, by its absolute path."""

    def add(self, named: Mapping[str, str]) -> None:
        """Compare the files that the configuration names, too.

        Args:
            named: The digest of each of them, by its absolute path.
        """
        self.named = named
        self._files += [_SourceFile(Path(path), found) for path, found in named.items()]

    def changed(self) -> bool:
        """Return whether contents have changed; a file is read only if its stamp has."""
        return any(file.changed() for file in self._files)


class _SourceFile:
    """One file.

    Args:
        path: The file.
        read: Digest of the contents that were read.
    """

    def __init__(self, path: Path, read: str) -> None:
        self._path, self._read = path, read
        self._stamp: tuple[int, ...] | None = None
        self._changed = False

    def changed(self) -> bool:
        """Return whether the contents have changed."""
        stamp = self._stamp_now()
        if stamp != self._stamp:
            self._stamp, self._changed = stamp, digest(self._path) != self._read
        return self._changed

    def _stamp_now(self) -> tuple[int, ...]:
        """Return what changes with the contents; empty if there is no such file."""
        with suppress(OSError):
            found = self._path.stat()
            if S_ISREG(found.st_mode):
                return found.st_mtime_ns, found.st_size, found.st_ino
        return ()
