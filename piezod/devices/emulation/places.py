"""Where emulated devices are served."""

import fcntl
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


def hold(path: Path) -> int | None:
    """Hold a place in the user's own folder, as long as this process lives and keeps it open.

    What is left there by a process that was killed is known by that: nobody holds it.

    Returns:
        The descriptor to be closed in the end; None for a place elsewhere, which nobody can hold.

    Raises:
        DeviceUnavailableError: If somebody else holds it.
        OSError: If it cannot be held.
    """
    if path.parent != own_folder():
        return None
    held = os.open(f"{path}.lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(held)
        what = f"{path} is served by another process: end it, or name another place"
        raise DeviceUnavailableError(what) from error
    return held


def address(where: str) -> tuple[str, int]:
    """Return the host and the port of "HOST:PORT", "PORT" or "", which is any port of this machine.

    Raises:
        DeviceUnavailableError: If it is nothing of them.
    """
    host, _, port = where.rpartition(":")
    if port and not (port.isdecimal() and int(port) < 65_536):
        raise DeviceUnavailableError(f"no address {where!r}, expected HOST:PORT or PORT, 0 for any")
    return host.strip("[]") or "127.0.0.1", int(port or 0)
