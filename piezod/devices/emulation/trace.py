"""A file with every voltage that was written to a rig, with time and process."""

from collections.abc import Sequence
from pathlib import Path
from typing import Self


class Trace:
    """A CSV file with a row for each accepted write; also a context manager.

    Columns: `t_ns`, the clock of the rig; `asked_ns`, the instant that the caller gave; `pid`, the
    process of the caller; then a voltage for each axis, `x_v` for axis x. A row is in the file
    before its write is answered.

    Args:
        path: Path of the file; an existing file is overwritten.
        axes: Names of the axes.
    """

    def __init__(self, path: Path, axes: Sequence[str]) -> None:
        self._file = path.open("w", encoding="ascii", buffering=1)
        self._put("t_ns", "asked_ns", "pid", *(f"{axis}_v" for axis in axes))

    def add(self, t_ns: int, asked_ns: int, pid: int, drive_v: Sequence[float]) -> None:
        """Add a row."""
        self._put(t_ns, asked_ns, pid, *drive_v)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        """Return the trace itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def _put(self, *fields: object) -> None:
        self._file.write(",".join(map(str, fields)) + "\n")
