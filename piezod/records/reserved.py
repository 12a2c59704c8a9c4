"""Room on the disk, taken before it is needed.

HDF5 does not survive a disk that is full: after a write that fails it cannot close the file, and
crashes the process at the latest when that ends. So room is reserved before each write, and where
there is none that is an error before HDF5 knows of it.
"""

import os
from pathlib import Path
from typing import Final

_HDF5_MAGIC: Final = b"\x89HDF\r\n\x1a\n"
_END_OF_FILE: Final = slice(28, 36)
"""Where the superblock, version 2 or 3, tells how long the file is."""


class Reserved:
    """A new file, and room behind what is in it.

    Args:
        path: The file; owner may write it, group may read it.

    Raises:
        OSError: If it exists already, be it as a link, or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        flags = os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_NOFOLLOW
        self._descriptor = os.open(path, flags, 0o640)

    def reserve(self, size_bytes: int) -> None:
        """Make sure that the file can grow to a size.

        Raises:
            OSError: If the disk has no room for that, or the size is not allowed.
        """
        present = os.fstat(self._descriptor).st_size
        if size_bytes > present:
            os.posix_fallocate(self._descriptor, present, size_bytes - present)

    def release(self) -> None:
        """Give back the room behind an HDF5 file that has been closed, and have it reach the disk.

        No calls after this.
        """
        try:
            superblock = os.pread(self._descriptor, _END_OF_FILE.stop, 0)
            if superblock.startswith(_HDF5_MAGIC) and superblock[8] in (2, 3):
                end = int.from_bytes(superblock[_END_OF_FILE], "little")
                if end < os.fstat(self._descriptor).st_size:
                    os.ftruncate(self._descriptor, end)
            os.fsync(self._descriptor)
        finally:
            os.close(self._descriptor)
