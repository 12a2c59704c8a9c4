"""A pty as the device end of a serial line."""

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
_RETRY_NS = 1_000_000
"""Time after which bytes for which there was no room are sent again."""
_NEVER = threading.Event()
"""Never set: used as a plain wait."""


class PtyEnd:
    """Implements `FarEnd` over a pty; a driver opens a link to it.

    The link may be opened and closed any number of times. Bytes that are sent while no client has
    it open are lost, as on a cable. One thread may receive while another one sends.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._fd = path, -1
        self._unsent, self._sending = b"", threading.Lock()
        self._held: int | None = None
        self._poll = select.poll()

    def place(self) -> str:
        """Path of the link."""
        return str(self._path)

    def appear(self) -> None:
        """Make the pty and the link to it; an existing link that is not served is replaced.

        That is a link to a path that does not exist, and in the user's own folder every link that
        is not locked: the number of its pty may belong to another program by now.

        Raises:
            DeviceUnavailableError: If the path is taken, or the link cannot be made.
        """
        self._fd, slave = pty.openpty()
        try:
            tty.setraw(slave)  # no echo and no line editing, as on a real port
            os.set_blocking(self._fd, False)
            self._held = hold(self._path)
            if self._path.is_symlink() and (self._held is not None or not self._path.exists()):
                self._path.unlink()
            self._path.symlink_to(os.ttyname(slave))
        except FileExistsError as error:
            self._close()
            what = f"{self._path} exists already: remove it if it is unused, or name another path"
            raise DeviceUnavailableError(what) from error
        except DeviceUnavailableError:
            self._close()
            raise
        except OSError as error:
            self._close()
            what = f"cannot make a port at {self._path}: {error}"
            raise DeviceUnavailableError(what) from error
        finally:
            os.close(slave)  # the client opens its own; while none has, poll reports a hang-up
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)

    def vanish(self) -> None:
        """Remove the link and close the pty; a client reads end of file."""
        self._unsent = b""
        if self._fd >= 0:
            with suppress(OSError):
                self._path.unlink()
            self._close()

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes, as soon as there are any; nothing if no client has it open."""
        if self._unsent:
            self.send(b"")
            within_ns = min(within_ns, _RETRY_NS)
        for _, events in self._poll.poll(within_ns / 1e6):
            if events & select.POLLIN:
                with suppress(OSError):  # the writer may have closed it meanwhile
                    return os.read(self._fd, _MOST_BYTES)
            _NEVER.wait(within_ns * 1e-9)  # without a client every poll returns at once
        return b""

    def send(self, data: bytes) -> None:
        """Send these bytes; none if no client has it open.

        A kernel takes only some kilobytes at once: the rest follows when it has room again.
        """
        client = select.poll()
        client.register(self._fd, 0)
        with self._sending:
            data, self._unsent = self._unsent + data, b""
            # Without this test the kernel would keep the bytes for the next client.
            if any(events & select.POLLHUP for _, events in client.poll(0)):
                return
            try:
                sent = os.write(self._fd, data)
            except BlockingIOError:  # no room at all
                sent = 0
            except OSError:  # the client has closed it meanwhile
                return
            self._unsent = data[sent:][-_MOST_BYTES:]

    def take_connected(self) -> bool:
        """Return False: a device on a serial line cannot detect a client."""
        return False

    def _close(self) -> None:
        os.close(self._fd)
        self._fd = -1
        if self._held is not None:
            os.close(self._held)
            self._held = None
