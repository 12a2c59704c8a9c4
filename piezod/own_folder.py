"""Folders that piezod makes for itself, with a mode that does not depend on the umask."""

import errno
import os
from contextlib import suppress
from pathlib import Path


def make_folder(path: Path, mode: int = 0o700) -> None:
    """Make a folder and the missing ones above it, all with one mode; an existing one is kept.

    `Path.mkdir` gives a mode to the last one only: under the umask 000, those above would be open
    to every user.

    Args:
        path: The folder.
        mode: Its mode; the umask can only take from it.

    Raises:
        OSError: If one cannot be made, or there is a file of its name.
    """
    missing = []
    for folder in (path, *path.parents):
        if folder.is_dir():
            break
        missing.append(folder)
    for folder in reversed(missing):
        with suppress(FileExistsError):  # another process was faster; a file there fails below
            os.mkdir(folder, mode)  # noqa: PTH102 - its error is what callers know
    if not path.is_dir():
        what = "there is a file of this name; move it away"
        raise FileExistsError(errno.EEXIST, what, str(path))
