"""A service manager that listens to a daemon."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def listening(folder: Path) -> Iterator[socket.socket]:
    """Give a socket like that of systemd, in a folder; its name is the `NOTIFY_SOCKET`."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.settimeout(10)
        manager.bind(str(folder / "notify"))
        yield manager


def waiting(manager: socket.socket) -> bytes:
    """Return all messages that have come, one after the other, without a wait."""
    found, within_s = [], manager.gettimeout()
    manager.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            found.append(manager.recv(1000))
    manager.settimeout(within_s)
    return b"".join(found)
