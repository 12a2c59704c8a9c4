"""Files that are written completely or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder; rename it to `path` when the block succeeds.

    A reader never sees an incomplete file, and a failed write leaves an older file unchanged. The
    temporary name contains the process id, so that two programs do not write to one file.

    Args:
        path: Path of the file; its folder is created if it is absent.

    Raises:
        OSError: If the folder or the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        if error.filename == str(temporary):
            error.filename = str(path)  # the caller knows this name, not the temporary one
        raise
    finally:
        temporary.unlink(missing_ok=True)
