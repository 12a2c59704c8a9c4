"""The small files of the runtime folder, kept in memory in case somebody removes the folder."""

from contextlib import suppress
from pathlib import Path
from typing import Final

from piezod.daemon.logging import logger
from piezod.daemon.paths import IDENTITIES, PLAYED

_KEPT: Final = (IDENTITIES, PLAYED, "config-*/*")
"""What `piezod safe` and clients read: patterns of names in the folder."""

_log = logger("supervisor")


class KeptFiles:
    """Copies of the files; a mapped memory lives on without its file and is none of them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._kept: dict[Path, tuple[tuple[int, int], bytes]] = {}

    def read(self) -> None:
        """Read the files that have changed; a file that is being replaced comes next time."""
        with suppress(OSError):
            for path in (path for pattern in _KEPT for path in self._folder.glob(pattern)):
                found = path.stat()
                stamp = found.st_mtime_ns, found.st_ino
                if path not in self._kept or self._kept[path][0] != stamp:
                    self._kept[path] = stamp, path.read_bytes()

    def restore(self) -> None:
        """Write the files that are not there any more; on a full disk they stay away."""
        try:
            for path, (_, content) in self._kept.items():
                if not path.exists():
                    path.parent.mkdir(mode=0o700, exist_ok=True)
                    path.touch(mode=0o600)
                    path.write_bytes(content)
        except OSError as error:
            _log.error("runtime folder not restored", why=str(error))
