"""Recordings whose writer was killed: HDF5 opens them plainly when their flags are cleared.

A writer sets flags in the superblock, the first 48 bytes, and clears them when it closes the file.
While they are set HDF5 takes the file for one that is being written. HDF5 has a program that clears
them, `h5clear`, which does not come with h5py: what it does is done here, without HDF5.
"""

import errno
import fcntl
import os
import struct
from pathlib import Path
from typing import Final

from piezod.errors import DataError
from piezod.reading.hdf5_magic import HDF5_MAGIC
from piezod.records.lookup3 import lookup3

END_OF_FILE: Final = slice(28, 36)
"""Bytes of the superblock, version 2 or 3, with the end-of-file address."""
_FORM: Final = slice(8, 11)
_KNOWN_FORMS: Final = (b"\x02\x08\x08", b"\x03\x08\x08")
"""Version of the superblock, and sizes of addresses and lengths, in bytes."""
_FLAGS: Final = slice(11, 12)
_CHECKED: Final = slice(0, 44)
_CHECKSUM: Final = slice(44, 48)
_WHOLE_FILE: Final = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
"""`struct flock` of the kernel."""


def repair(path: Path) -> bool:
    """Clear the flags of a recording that was not closed; return whether that was necessary.

    The records in the file stay as they are; the last second or so before the end is not in it.

    Raises:
        DataError: If it is no recording, is damaged, or is still being written.
        OSError: If it cannot be read or written.
    """
    with path.open("rb") as file:
        superblock = file.read(_CHECKSUM.stop)
    if not superblock.startswith(HDF5_MAGIC) or superblock[_FORM] not in _KNOWN_FORMS:
        raise DataError(f"{path}: it is not a recording: it does not begin as such an HDF5 file")
    if lookup3(superblock[_CHECKED]) != int.from_bytes(superblock[_CHECKSUM], "little"):
        raise DataError(f"{path}: its first bytes are damaged: the checksum does not fit them")
    if superblock[_FLAGS] == b"\0":
        return False
    descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
    try:
        _lock(descriptor, path)
        _write(descriptor, superblock)
    finally:
        os.close(descriptor)
    return True


def lock_for_writing(descriptor: int) -> None:
    """Mark a file as being written until its descriptor is closed, or the process ends.

    Raises:
        OSError: If it is being written already.
    """
    # Neither `flock`, by which HDF5 would refuse readers, nor `lockf`, which ends when HDF5 closes
    # another descriptor of the file.
    fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, _WHOLE_FILE)


def _lock(descriptor: int, path: Path) -> None:
    try:
        lock_for_writing(descriptor)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EAGAIN):
            raise
        raise DataError(f"{path}: it is still being written; `piezod record stop` first") from error


def _write(descriptor: int, superblock: bytes) -> None:
    size = os.fstat(descriptor).st_size.to_bytes(8, "little")
    # The whole file, because what was written last may lie behind the noted end.
    clean = superblock[: _FLAGS.start] + b"\0" + superblock[_FLAGS.stop : END_OF_FILE.start]
    clean += size + superblock[END_OF_FILE.stop : _CHECKED.stop]
    os.pwrite(descriptor, clean + lookup3(clean).to_bytes(4, "little"), 0)
    os.fsync(descriptor)
