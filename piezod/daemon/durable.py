"""Files that survive a power failure: the old file or the new one is there, never half of one."""

import os
from pathlib import Path

from piezod.errors import naming

_TEMPORARY = ".part"


def write_durably(path: Path, content: bytes) -> None:
    """Write a file so that after a power failure it is there completely or not at all.

    The order ensures it: the contents reach the disk before the name does, and the name reaches it
    before this function returns.

    Args:
        path: The file; its folder must exist.
        content: All of it.

    Raises:
        OSError: If it cannot be written. An older file is then unchanged, unless only the last step
            failed: then either file may be there.
    """
    # In the same folder, because a rename cannot cross file systems.
    temporary = path.with_name(f".{path.name}.{os.getpid()}{_TEMPORARY}")
    try:
        with naming(path):
            _write_and_sync(temporary, content)
        os.rename(temporary, path)  # noqa: PTH104 - like os.fsync, which pathlib does not have
    except BaseException:  # Ctrl-C included
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk.

    Raises:
        OSError: If that fails.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sweep_temporaries(folder: Path) -> None:
    """Remove the files of interrupted writes; only while no other process writes there."""
    for path in folder.glob(f".*{_TEMPORARY}"):
        path.unlink(missing_ok=True)


def _write_and_sync(path: Path, content: bytes) -> None:
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    descriptor = os.open(path, flags, 0o640)
    try:
        rest = memoryview(content)
        while rest:  # a disk that is nearly full may take a part only
            rest = rest[os.write(descriptor, rest) :]
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
