"""A folder of recordings; only the daemon makes their names."""

import re
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Final

from piezod.messages.stores import RecordingFile
from piezod.own_folder import make_folder
from piezod.records.recording.part_names import RECORDING_NAME, without_part

_LABEL: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
_SUFFIX: Final = ".h5"
_KEPT: Final = ".keep"
"""Ending of the empty file that marks a recording as kept."""


class RecordingsFolder:
    """Makes names, finds and lists files, and limits their number.

    Args:
        path: The folder; made if it is absent.

    Raises:
        OSError: If it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        make_folder(path, 0o750)
        self.path = path

    def new(self, when: datetime, label: str = "") -> Path:
        """Return the path of a new file, as in `20240501T120000Z-label.h5`.

        Args:
            when: Time of day, with its zone.
            label: End of the name: up to 32 letters, digits, `_` and `-`.

        Raises:
            ValueError: If the label has other characters or is longer.
        """
        if label and not _LABEL.fullmatch(label):
            raise ValueError(
                f"label {label[:40]!r}: allowed are up to 32 letters, digits, _ and -, "
                "the first a letter or digit"
            )
        time = f"{when.astimezone(UTC):%Y%m%dT%H%M%SZ}"
        number = 1
        while True:
            parts = [time] + [str(number)] * (number > 1) + [label] * bool(label)
            path = self.path / ("-".join(parts) + _SUFFIX)
            if not path.exists():
                return path
            number += 1

    def path_of(self, name: str) -> Path:
        """Return the path of a file in `files`."""
        return self.path / f"{name}{_SUFFIX}"

    def find(self, name: str) -> Path | None:
        """Return the file of a name, or None; no name leads out of the folder."""
        path = self.path_of(name)
        # The pattern first: it refuses "..", slashes and zero bytes before the disk is asked.
        found = RECORDING_NAME.fullmatch(name) and path.is_file() and not path.is_symlink()
        return path if found else None

    def files(self) -> tuple[RecordingFile, ...]:
        """Return the files, newest first."""
        # Names begin with the time, so that their order is that of time.
        names = sorted((path.stem for path in self.path.glob(f"*{_SUFFIX}")), reverse=True)
        found = [(name, path) for name in names if (path := self.find(name))]
        return tuple(
            RecordingFile(name, path.stat().st_size, self._is_kept(name)) for name, path in found
        )

    def keep(self, name: str, kept: bool) -> bool:
        """Mark a recording, or one of its files, as kept, or remove the mark.

        The mark of a recording holds for all its files.

        Returns:
            Whether there is a file of that name.

        Raises:
            OSError: If the folder cannot be written.
        """
        if self.find(name) is None:
            return False
        if kept:
            self._mark(name).touch()
        else:
            self._mark(name).unlink(missing_ok=True)
        return True

    def limit(self, total_bytes: float, writing: str) -> str:
        """Remove the oldest files until all are within a size; return why that fails, or "".

        Args:
            total_bytes: Largest size of all files together.
            writing: Name of the file that is being written; it stays, as kept ones do.

        Raises:
            OSError: If a file cannot be removed.
        """
        if total_bytes == inf:
            return ""
        files = self.files()
        size_bytes = sum(file.size_bytes for file in files)
        for file in reversed(files):
            if size_bytes <= total_bytes:
                return ""
            if file.name != writing and not file.kept:
                self.path_of(file.name).unlink(missing_ok=True)
                size_bytes -= file.size_bytes
        if size_bytes <= total_bytes:
            return ""
        return (
            f"the recordings that may not be removed have {size_bytes / 1e6:.0f} MB, and "
            f"{total_bytes / 1e6:.0f} MB are allowed; fetch and delete some, or raise max_total_mb"
        )

    def _is_kept(self, name: str) -> bool:
        return self._mark(name).exists() or self._mark(without_part(name)).exists()

    def _mark(self, name: str) -> Path:
        return self.path / f"{name}{_KEPT}"

    def keep_newest(self, number: int) -> None:
        """Remove all files except the newest."""
        for file in self.files()[number:]:
            self.path_of(file.name).unlink(missing_ok=True)
