"""Files and folders on the command line, checked before any work begins."""

import errno
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

if TYPE_CHECKING:
    from pydantic import BaseModel

ModelT = TypeVar("ModelT", bound="BaseModel")


def existing_file(path: Path | None) -> Path | None:
    """Return the path unchanged, if it is that of a file.

    Args:
        path: The path; None if the user gave none.

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

    Args:
        folder: An existing folder.

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


def load_file(file: Path, model: type[ModelT]) -> ModelT:
    """Return the contents of a YAML file, checked.

    Raises:
        ConfigError: If they are not valid; the text lists every problem with its place.
    """
    from piezod.config.fields import Context
    from piezod.config.validate import validate
    from piezod.config.yaml_loader import load_yaml

    return validate(load_yaml(file), model, Context(file.parent))
