"""Places at which emulated devices are served."""

import fcntl
import os
import tempfile
from pathlib import Path

from piezod.errors import DeviceUnavailableError
from piezod.own_folder import make_folder


def own_folder() -> Path:
    """Return the user's folder for sockets and ports, which may not exist.

    It is $XDG_RUNTIME_DIR/piezod, or else ${TMPDIR:-/tmp}/piezod-UID.
    """
    users = os.environ.get("XDG_RUNTIME_DIR")
    return (
        Path(users) / "piezod" if users else Path(tempfile.gettempdir()) / f"piezod-{os.getuid()}"
    )


def make_own_folder() -> Path:
    """Return `own_folder`, which then exists and belongs to this user.

    Raises:
        DeviceUnavailableError: If it belongs to another user.
    """
    folder = own_folder()
    make_folder(folder)
    # Everyone can write to /tmp, so another user may have made the folder first.
    if folder.stat().st_uid != os.getuid():
        raise DeviceUnavailableError(f"{folder} belongs to another user, name another place")
    return folder


def hold(path: Path) -> int | None:
    """Lock a place in the user's own folder, for the life of this process.

    The lock ends when the descriptor is closed. A place that a killed process left behind can be
    recognised: it is not locked.

    Returns:
        The descriptor to close at the end; None for a place elsewhere, which cannot be locked.

    Raises:
        DeviceUnavailableError: If another process holds the lock.
        OSError: If it cannot be locked.
    """
    if path.parent != own_folder():
        return None
    held = os.open(f"{path}.lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(held)
        what = f"{path} is served by another process: end it, or name another place"
        raise DeviceUnavailableError(what) from error
    return held


def address(where: str) -> tuple[str, int]:
    """Return host and port of "HOST:PORT", "PORT" or "" (any port of this machine).

    Raises:
        DeviceUnavailableError: If the text is none of these.
    """
    host, _, port = where.rpartition(":")
    if port and not (port.isdecimal() and int(port) < 65_536):
        what = f"invalid address {where!r}, expected HOST:PORT or PORT, 0 for any port"
        raise DeviceUnavailableError(what)
    return host.strip("[]") or "127.0.0.1", int(port or 0)
