"""Files that survive a loss of power: the old one or the new one is there, never half of one."""

import os
from pathlib import Path

_TEMPORARY = ".part"


def write_durably(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all, whenever the power fails.

    The order is what makes it so: the content reaches the disk before its name does, and the name
    does before this returns.

    Args:
        path: The file; its folder must exist.
        content: All of it.

    Raises:
        OSError: If it cannot be written; an older file is then as it was, unless only the last
            step failed, after which either may be found.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}{_TEMPORARY}")
    try:
        _write_and_sync(temporary, content)
        os.rename(temporary, path)  # noqa: PTH104 - beside os.fsync, which pathlib has not
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Have the names in a folder reach the disk.

    Raises:
        OSError: If that fails.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sweep_temporaries(folder: Path) -> None:
    """Remove what a write left behind that was cut off; only while nobody else writes there."""
    for path in folder.glob(f".*{_TEMPORARY}"):
        path.unlink(missing_ok=True)


def _write_and_sync(path: Path, content: bytes) -> None:
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    descriptor = os.open(path, flags, 0o640)
    try:
        rest = memoryview(content)
        while rest:  # a disk that is nearly full takes a part
            rest = rest[os.write(descriptor, rest) :]
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
