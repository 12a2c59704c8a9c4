"""Opens HDF5 files of unknown condition: a file in progress, a finished one, a damaged one."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import h5py

from piezod.errors import DataError

_WRITER_FLAGS: Final = 11
"""The byte of the superblock, version 3, in which a writer notes that it is at work."""
_DAMAGE: Final = (
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""What h5py raises, beside OSError, if a part is missing or has another type or an absurd size."""


def open_recording(path: Path, **options: Any) -> h5py.File:
    """Open a recording, which may be in progress.

    Args:
        path: Path of the file.
        **options: Further options of `h5py.File`.

    Raises:
        OSError: If the file cannot be opened, or is not HDF5.
    """
    with path.open("rb") as file:
        superblock = file.read(_WRITER_FLAGS + 1)
    # Beside a writer, HDF5 reads metadata with a wrong checksum again and again, for hours. In a
    # finished file they are damaged.
    in_progress = superblock[_WRITER_FLAGS:] not in {b"", b"\0"}
    return h5py.File(path, "r", swmr=in_progress, libver="v110", **options)


@contextmanager
def damage_is_an_error(path: Path) -> Iterator[None]:
    """Raise what h5py raises while it reads damaged contents as a DataError with the path."""
    try:
        yield
    except _DAMAGE as error:
        what = str(error) or type(error).__name__
        raise DataError(f"{path}: it is damaged, or another program wrote it: {what}") from error
