"""A folder of recordings; only the daemon makes their names."""

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

_LABEL: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
_NAME: Final = re.compile(r"[0-9]{8}T[0-9]{6}Z(-[0-9]+)?(-[A-Za-z0-9][A-Za-z0-9_-]{0,31})?")
_SUFFIX: Final = ".h5"


class StoredRecording(NamedTuple):
    """A file in the folder.

    Attributes:
        name: Its name, without the suffix.
        size_bytes: Its size.
    """

    name: str
    size_bytes: int


class RecordingsFolder:
    """Makes names, finds and lists files, and limits their number.

    Args:
        path: The folder; made if it is absent.

    Raises:
        OSError: If it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        path.mkdir(mode=0o750, parents=True, exist_ok=True)
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
        found = _NAME.fullmatch(name) and path.is_file() and not path.is_symlink()
        return path if found else None

    def files(self) -> tuple[StoredRecording, ...]:
        """Return the files, newest first."""
        # Names begin with the time, so that their order is that of time.
        names = sorted((path.stem for path in self.path.glob(f"*{_SUFFIX}")), reverse=True)
        found = [(name, path) for name in names if (path := self.find(name))]
        return tuple(StoredRecording(name, path.stat().st_size) for name, path in found)

    def keep_newest(self, number: int) -> None:
        """Remove all files except the newest."""
        for file in self.files()[number:]:
            self.path_of(file.name).unlink(missing_ok=True)
