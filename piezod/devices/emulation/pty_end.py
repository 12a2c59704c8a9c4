"""A pty as the far end of a serial line."""

import os
import pty
import select
import threading
import tty
from contextlib import suppress
from pathlib import Path

from piezod.devices.emulation.places import hold
from piezod.errors import DeviceUnavailableError

_MOST_BYTES = 65_536
_UNPLUGGED = threading.Event()
"""Never set: waits where there is nothing to wait for."""


class PtyEnd:
    """Implements `FarEnd`: a driver opens what is at a path, a link to the pty.

    It may be opened and closed again and again; what is sent while nobody has it open is lost, as
    it would be on a cable.

    Args:
        path: Where the link is made.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._fd = path, -1
        self._held: int | None = None
        self._poll = select.poll()

    def place(self) -> str:
        """The path of the link."""
        return str(self._path)

    def appear(self) -> None:
        """Make the pty and the link to it; one that is there and that nobody serves is replaced.

        That is a link that leads nowhere, and in the user's own folder any that nobody holds: the
        number of its pty may have become somebody else's.

        Raises:
            DeviceUnavailableError: If there is something else at the path, or it cannot be made.
        """
        self._fd, slave = pty.openpty()
        try:
            tty.setraw(slave)
            os.set_blocking(self._fd, False)
            self._held = hold(self._path)
            if self._path.is_symlink() and (self._held is not None or not self._path.exists()):
                self._path.unlink()
            self._path.symlink_to(os.ttyname(slave))
        except FileExistsError as error:
            self._close()
            what = f"{self._path} is there already: remove it if nobody serves it, or name another"
            raise DeviceUnavailableError(what) from error
        except DeviceUnavailableError:
            self._close()
            raise
        except OSError as error:
            self._close()
            raise DeviceUnavailableError(f"no port can be made at {self._path}: {error}") from error
        finally:
            os.close(slave)
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)

    def vanish(self) -> None:
        """Remove the link and close the pty: whoever has it open reads its end."""
        if self._fd >= 0:
            with suppress(OSError):
                self._path.unlink()
            self._close()

    def receive(self, within_ns: int) -> bytes:
        """Return what has come, as soon as something has; nothing where nobody has it open."""
        for _, events in self._poll.poll(within_ns / 1e6):
            if events & select.POLLIN:
                with suppress(OSError):  # who wrote may have closed it meanwhile
                    return os.read(self._fd, _MOST_BYTES)
            _UNPLUGGED.wait(within_ns * 1e-9)  # nobody has it open, which ends every poll at once
        return b""

    def send(self, data: bytes) -> None:
        """Send this, or as much of it as there is room for; nothing where nobody has it open."""
        if not any(events & select.POLLHUP for _, events in self._poll.poll(0)):
            with suppress(OSError):
                os.write(self._fd, data)

    def take_connected(self) -> bool:
        """Never tell: a device on a serial line does not know."""
        return False

    def _close(self) -> None:
        os.close(self._fd)
        self._fd = -1
        if self._held is not None:
            os.close(self._held)
            self._held = None
