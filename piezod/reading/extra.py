"""Optional libraries for some formats."""

import importlib
from pathlib import Path
from typing import Any

from piezod.errors import DataError


def library(name: str, what: str, file: Path) -> Any:
    """Return an optional library.

    Args:
        name: Name of its module.
        what: Kind of file that needs it, for the message.
        file: The file.

    Raises:
        DataError: If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise DataError(
            f"{file}: {what} needs {name}, which is not installed: `pip install 'piezod[import]'`"
        ) from error
