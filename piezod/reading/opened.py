"""Opens HDF5 files of unknown condition: a file in progress, a finished, damaged or hostile one."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import h5py

from piezod import resource_limits
from piezod.errors import DataError
from piezod.given_file import open_given
from piezod.reading.hdf5_magic import MOST_FILE_BYTES, superblock_of
from piezod.reading.hdf5_structure import check_structure, usable_datasets

MOST_READ_BYTES: Final = 4_000_000_000
"""Largest size of what is read at once."""
LOOK_WITHIN_S: Final = 30
"""Longest time for a look through a file, in s."""
_LOOK: Final = "piezod.reading.look"
_REMEDY: Final = "take another copy of it, or record again"
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


FOREIGN: Final = "foreign"
"""Word for the process that looks: another program wrote the file."""


def open_recording(path: Path, *, foreign: bool = False, **options: Any) -> h5py.File:
    """Open an HDF5 file for reading, after a look through it; it may be in progress.

    HDF5 may loop for ever, take all memory, or crash on a damaged file. Therefore a process of its
    own looks first, with bounds of time and memory; it takes 0.15 s. A process that has such bounds
    itself does without.

    Args:
        path: Path of the file.
        foreign: Whether another program may have written it, so that anything may be beside the
            plain arrays.
        **options: Further options of `h5py.File`.

    Raises:
        DataError: If it is no regular file, too large, damaged, or leads out of itself.
        OSError: If there is no such file, or it may not be read.
    """
    begin = superblock_of(path)
    with open_given(path, MOST_FILE_BYTES) as file:
        file.seek(begin or 0)
        superblock = file.read(_WRITER_FLAGS + 1)
    # Beside a writer, HDF5 reads metadata with a wrong checksum again and again, for hours. In a
    # finished file they are damaged.
    in_progress = superblock[_WRITER_FLAGS:] not in {b"", b"\0"}
    if begin is None:
        raise DataError(f"{path}: this is not an HDF5 file; needed is one that piezod wrote")
    bounded = resource_limits.is_bounded()
    if not bounded:
        _look(path, foreign=foreign)
    with damage_is_an_error(path), ExitStack() as stack:
        opened = h5py.File(path, "r", swmr=in_progress, libver="v110", **options)
        stack.callback(opened.close)
        if bounded:
            usable_datasets(opened) if foreign else check_structure(opened)
        stack.pop_all()
    return opened


@contextmanager
def damage_is_an_error(path: Path) -> Iterator[None]:
    """Raise what h5py raises while it reads damaged contents as a DataError with the path."""
    try:
        yield
    except DataError as error:
        if str(error).startswith(f"{path}: "):
            raise
        raise DataError(f"{path}: {error}") from error
    except (OSError, *_DAMAGE) as error:
        if isinstance(error, OSError) and error.errno:
            raise  # of the disk; h5py's own has no number
        what = str(error) or type(error).__name__
        raise DataError(f"{path}: it is damaged, or another program wrote it: {what}") from error


def _look(path: Path, *, foreign: bool) -> None:
    command = [sys.executable, "-m", _LOOK, str(path), *([FOREIGN] if foreign else [])]
    nothing, pipe = subprocess.DEVNULL, subprocess.PIPE
    try:
        done = subprocess.run(  # noqa: S603 - our own interpreter and module
            command, stdin=nothing, stdout=pipe, stderr=nothing, timeout=LOOK_WITHIN_S, check=False
        )
    except subprocess.TimeoutExpired:
        what = f"HDF5 has not found its way through it within {LOOK_WITHIN_S} s"
        raise DataError(f"{path}: {what}: it is damaged; {_REMEDY}") from None
    if text := done.stdout.decode(errors="surrogateescape"):
        raise DataError(text)
    if done.returncode:
        raise DataError(f"{path}: HDF5 fails on it, or takes too much memory: damaged; {_REMEDY}")
