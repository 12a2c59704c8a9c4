"""The folders of a user, by the variables of the XDG base directory specification."""

import errno
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

_BELOW_HOME: Final = {
    "XDG_CACHE_HOME": ".cache",
    "XDG_CONFIG_HOME": ".config",
    "XDG_STATE_HOME": ".local/state",
}


def user_folder(variable: str, environ: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of the user that a variable names, or its default below the home.

    A relative path counts as absent, as the specification says.

    Args:
        variable: `XDG_CACHE_HOME`, `XDG_CONFIG_HOME` or `XDG_STATE_HOME`.
        environ: The environment variables.

    Raises:
        FileNotFoundError: If neither the variable nor a home is known, as in a container that runs
            as a user without an entry.
    """
    given = Path(environ.get(variable, ""))
    if given.is_absolute():
        return given
    try:
        return Path.home() / _BELOW_HOME[variable]
    except RuntimeError:
        what = f"this user has no home: set {variable}, or HOME, to a folder that it may write to"
        raise FileNotFoundError(errno.ENOENT, what, "~") from None
