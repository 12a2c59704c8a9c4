"""Files and folders on the command line, checked before any work begins."""

import errno
import os
import tempfile
from pathlib import Path

import typer


def existing_file(path: Path | None) -> Path | None:
    """Return the path unchanged, if it is that of a file.

    Raises:
        typer.BadParameter: If there is no such file, or it is a folder.
        OSError: If the permission to look at it is missing.
    """
    if path is not None:
        try:
            path.stat()
        except (FileNotFoundError, NotADirectoryError) as error:
            raise typer.BadParameter(f"no such file (got {path})") from error
        if path.is_dir():
            raise typer.BadParameter(f"must be a file, this is a folder (got {path})")
    return path


def check_writable(folder: Path) -> None:
    """Refuse a folder in which no file can be made.

    Raises:
        OSError: If it is not writable; the message names the folder.
    """
    # Only an attempt is reliable: permission bits do not show a read-only or full disk.
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except PermissionError as error:
        what = os.strerror(errno.EACCES)
        raise PermissionError(errno.EACCES, f"cannot be written to: {what}", str(folder)) from error
    except OSError as error:
        raise OSError(
            error.errno, f"cannot be written to: {error.strerror}", str(folder)
        ) from error


def check_yaml_out(out: Path | None) -> None:
    """Refuse a YAML file that cannot be written, before the work that makes its contents.

    Raises:
        typer.BadParameter: If its suffix is not that of a YAML file.
        OSError: If its folder is not writable.
    """
    if out is None:
        return
    if out.suffix not in (".yaml", ".yml"):
        raise typer.BadParameter(f"must end in .yaml (got {out})", param_hint="'--out'")
    if out.parent.is_dir():
        check_writable(out.parent)
