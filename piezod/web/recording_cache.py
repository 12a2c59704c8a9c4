"""Copies of recordings that this user may not read where they are, up to a total size."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Self

from piezod.home import user_folder
from piezod.own_folder import make_folder

MOST_BYTES: Final = 4_000_000_000
"""Largest size of all copies together; the newest copy stays even if it is larger."""


class RecordingCache:
    """A folder of copies, of which the oldest make room.

    Args:
        folder: The folder; made with the first copy.
        most_bytes: Largest size of all copies together.
    """

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES) -> None:
        self._folder, self._most_bytes = folder, most_bytes

    @classmethod
    def of_user(cls, environ: Mapping[str, str] = os.environ) -> Self:
        """Return that of this user, or of this service."""
        if folder := environ.get("CACHE_DIRECTORY"):
            return cls(Path(folder) / "recordings")
        return cls(user_folder("XDG_CACHE_HOME", environ) / "piezod" / "recordings")

    def path(self, stage: str, name: str) -> Path:
        """Return where the copy of a recording is, or would be."""
        return self._folder / stage / f"{name}.h5"

    def add(self, path: Path, fetch: Callable[[Path], object]) -> Path:
        """Make a copy; return its path.

        Args:
            path: Where it belongs.
            fetch: Writes a file whole or not at all.

        Raises:
            OSError: If the folder cannot be written.
        """
        make_folder(path.parent)
        fetch(path)
        self._make_room(path)
        return path

    def _make_room(self, newest: Path) -> None:
        files = sorted(self._folder.glob("*/*.h5"), key=lambda file: file.stat().st_mtime_ns)
        total_bytes = sum(file.stat().st_size for file in files)
        for file in files:
            if total_bytes <= self._most_bytes:
                return
            if file != newest:
                total_bytes -= file.stat().st_size
                file.unlink()
