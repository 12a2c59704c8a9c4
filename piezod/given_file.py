"""Files that a person gives: the one place where a file of unknown kind and size is opened."""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO, Final

from piezod.errors import DataError

_KINDS: Final = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
    stat.S_IFDIR: "a folder",
}


def open_given(path: Path, most_bytes: int, *, follow: bool = True) -> BinaryIO:
    """Open a file for reading, if it is a regular one of bounded size.

    Anything else might wait for a writer for ever, or never end.

    Args:
        path: Path of the file.
        most_bytes: Largest allowed size.
        follow: Whether the file may be a link.

    Raises:
        DataError: If it is no regular file, or larger; the text has path, size and remedy.
        OSError: If there is no such file, or it cannot be read.
    """
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY
    try:
        descriptor = os.open(path, flags if follow else flags | os.O_NOFOLLOW)
    except OSError as error:
        if error.errno != errno.ENXIO:  # a socket, which cannot be opened
            raise
        raise _not_regular(path, stat.S_IFSOCK) from error
    found = os.fstat(descriptor)
    if stat.S_ISREG(found.st_mode) and found.st_size <= most_bytes:
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if stat.S_ISREG(found.st_mode):
        raise _too_large(path, most_bytes)
    raise _not_regular(path, stat.S_IFMT(found.st_mode))


def read_given(path: Path, most_bytes: int) -> bytes:
    """Return the contents of a regular file of bounded size; errors are those of `open_given`."""
    with open_given(path, most_bytes) as file:
        content = file.read(
            most_bytes + 1
        )  # it may grow meanwhile, and those of /proc have no size
    if len(content) > most_bytes:
        raise _too_large(path, most_bytes)
    return content


def _too_large(path: Path, most_bytes: int) -> DataError:
    return DataError(
        f"{path}: the file is too large, allowed: at most {most_bytes} bytes; give a shorter one"
    )


def _not_regular(path: Path, kind: int) -> DataError:
    return DataError(
        f"{path}: this is {_KINDS.get(kind, 'no file')}; allowed is a regular file; copy the "
        "contents into one, and give its path"
    )
