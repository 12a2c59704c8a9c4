"""Where emulated devices are served."""

import os
import tempfile
from pathlib import Path

from piezod.errors import DeviceUnavailableError


def own_folder() -> Path:
    """Return the user's folder for sockets and ports: $XDG_RUNTIME_DIR/piezod or /tmp/piezod-UID.

    It may not be there.
    """
    users = os.environ.get("XDG_RUNTIME_DIR")
    return (
        Path(users) / "piezod" if users else Path(tempfile.gettempdir()) / f"piezod-{os.getuid()}"
    )


def make_own_folder() -> Path:
    """Return `own_folder`, which is there and belongs to this user.

    Raises:
        DeviceUnavailableError: If it belongs to somebody else.
    """
    folder = own_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.stat().st_uid != os.getuid():
        raise DeviceUnavailableError(f"{folder} belongs to somebody else, name another place")
    return folder


def address(where: str) -> tuple[str, int]:
    """Return the host and the port of "HOST:PORT", "PORT" or "", which is any port of this machine.

    Raises:
        DeviceUnavailableError: If it is nothing of them.
    """
    host, _, port = where.rpartition(":")
    if port and not (port.isdecimal() and int(port) < 65_536):
        raise DeviceUnavailableError(f"no address {where!r}, expected HOST:PORT or PORT, 0 for any")
    return host.strip("[]") or "127.0.0.1", int(port or 0)
