"""Whether a file is HDF5, without the library, which takes long to import."""

from pathlib import Path
from typing import Final

from piezod.given_file import open_given

HDF5_MAGIC: Final = b"\x89HDF\r\n\x1a\n"
MOST_FILE_BYTES: Final = 100_000_000_000
_FIRST_USER_BLOCK: Final = 512


def is_hdf5(path: Path) -> bool:
    """Return whether a file is in the format of recordings; a missing file is not.

    Raises:
        DataError: If it is no regular file.
        OSError: If it cannot be read.
    """
    return superblock_of(path) is not None


def superblock_of(path: Path) -> int | None:
    """Return where HDF5 begins in a file: behind a block of the user, whose size doubles.

    Raises:
        DataError: If it is no regular file.
        OSError: If it cannot be read.
    """
    try:
        with open_given(path, MOST_FILE_BYTES) as file:
            end, place = file.seek(0, 2), 0
            while place < end:
                file.seek(place)
                if file.read(len(HDF5_MAGIC)) == HDF5_MAGIC:
                    return place
                place = 2 * place or _FIRST_USER_BLOCK
    except FileNotFoundError:
        pass
    return None
