"""Reservation of disk space before HDF5 needs it.

HDF5 cannot handle a full disk: after a failed write it cannot close the file, and it crashes the
process at its exit at the latest. The writer therefore reserves space before each write. If the
disk is full, that is an error before HDF5 is involved.
"""

import os
from pathlib import Path

from piezod.reading.hdf5_magic import HDF5_MAGIC
from piezod.records.repair import END_OF_FILE, lock_for_writing


class Reserved:
    """A new file with reserved space behind its content.

    Args:
        path: Path of the file; the owner may write it, the group may read it.

    Raises:
        OSError: If it exists already, also as a link, or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        flags = os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_NOFOLLOW
        self._descriptor = os.open(path, flags, 0o640)
        lock_for_writing(self._descriptor)

    def reserve(self, size_bytes: int) -> None:
        """Reserve space up to a file size, in bytes.

        Raises:
            OSError: If the disk is full, or the size is not allowed.
        """
        present = os.fstat(self._descriptor).st_size
        if size_bytes > present:
            os.posix_fallocate(self._descriptor, present, size_bytes - present)

    def release(self) -> None:
        """Release the space behind a closed HDF5 file, and write the file to the disk.

        Do not call any method after this one.
        """
        try:
            superblock = os.pread(self._descriptor, END_OF_FILE.stop, 0)
            # HDF5 knows where its content ends; the reserved space lies behind it.
            if superblock.startswith(HDF5_MAGIC) and superblock[8] in (2, 3):
                end = int.from_bytes(superblock[END_OF_FILE], "little")
                if end < os.fstat(self._descriptor).st_size:
                    os.ftruncate(self._descriptor, end)
            os.fsync(self._descriptor)  # after this a power failure does not lose the file
        finally:
            os.close(self._descriptor)
