"""Exit codes of errors, and their text without a traceback."""

import errno
import os
from typing import Final

from piezod.errors import (
    AlreadyRunningError,
    AmbiguousStageError,
    ConfigError,
    DeviceUnavailableError,
    NotAllowedError,
    NotRunningError,
    PiezodError,
    StillDrivenError,
    UnreachableError,
)

FAILED = 1
USAGE = 2
DEVICE_UNAVAILABLE = 69
STILL_DRIVEN = 74
ALREADY_RUNNING = 75
NO_PERMISSION = 77
CONFIGURATION = 78
"""As in sysexits.h. typer exits with 2 for wrong usage; 130 for Ctrl-C is in `interrupt`."""


_CODES: Final[dict[type[PiezodError], int]] = {
    AlreadyRunningError: ALREADY_RUNNING,
    AmbiguousStageError: USAGE,
    ConfigError: CONFIGURATION,
    DeviceUnavailableError: DEVICE_UNAVAILABLE,
    NotAllowedError: NO_PERMISSION,
    NotRunningError: DEVICE_UNAVAILABLE,
    StillDrivenError: STILL_DRIVEN,
    UnreachableError: DEVICE_UNAVAILABLE,
}


def exit_code(error: PiezodError | OSError) -> int:
    """Return the exit code of an error."""
    # A missing permission has its own code, whichever reader of the file met it.
    if isinstance(error, PermissionError) or isinstance(error.__cause__, PermissionError):
        return NO_PERMISSION
    return next((code for kind, code in _CODES.items() if isinstance(error, kind)), FAILED)


def text_of(error: PiezodError | OSError) -> str:
    """Return the text of an error for people."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        remedy = "; delete files there" if error.errno == errno.ENOSPC else ""
        return f"{os.fsdecode(error.filename)}: {error.strerror}{remedy}"
    return str(error)
