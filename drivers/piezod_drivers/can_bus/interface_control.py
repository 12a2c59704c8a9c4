"""Takes a CAN interface of the kernel down and up, to empty its transmit queue."""

import errno
import socket
import weakref
from fcntl import ioctl
from pathlib import Path
from struct import Struct
from typing import Final, Protocol

from piezod.errors import DeviceUnavailableError

# Numbers of linux/if.h and linux/sockios.h.
_REQUEST: Final = Struct("16sh22x")  # struct ifreq: the name and the flags of an interface
_GET_FLAGS: Final = 0x8913  # SIOCGIFFLAGS
_SET_FLAGS: Final = 0x8914  # SIOCSIFFLAGS
_UP: Final = 1  # IFF_UP


class InterfaceControl(Protocol):
    """What `LibraryBus` needs of the kernel's network interfaces."""

    def down_count(self, name: str) -> int:
        """Return how often an interface was down, which empties its queue; 0 if unknown."""
        ...

    def restart(self, name: str) -> None:
        """Take an interface down and up.

        Raises:
            DeviceUnavailableError: If this process lacks the right to do so.
        """
        ...


class KernelInterfaces:
    """Implements `InterfaceControl`.

    `carrier_down_count` counts how often an interface lost its bus, but not how often it was taken
    down. Every socket that is bound to the interface receives an error when it is taken down, so
    one socket that receives nothing else is kept for that.
    """

    def __init__(self) -> None:
        self._monitor: socket.socket | None = None
        self._taken_down = 0

    def down_count(self, name: str) -> int:
        """Return how often the interface was down since the first call; 0 if it is absent."""
        if self._monitor is None:
            self._monitor = _monitor(name)
            if self._monitor is not None:
                # This object has no `close`; the socket is closed when the object is collected.
                weakref.finalize(self, self._monitor.close)
        # Reading SO_ERROR also clears it. The next call opens a new socket.
        elif self._monitor.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._taken_down += 1
            self._close_monitor()
        try:
            count = Path(f"/sys/class/net/{name}/carrier_down_count").read_text("ascii")
            return int(count) + self._taken_down
        except (OSError, ValueError):
            return self._taken_down

    def restart(self, name: str) -> None:
        """Take an interface down and up; needs CAP_NET_ADMIN.

        Raises:
            DeviceUnavailableError: If this process lacks the right, or there is no such interface.
        """
        try:
            # The ioctl needs any socket; its family does not matter.
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control_socket:
                request = _REQUEST.pack(name.encode()[:15], 0)
                # An interface name has at most 15 bytes (IFNAMSIZ is 16, with the zero at the end).
                flags = _REQUEST.unpack(ioctl(control_socket, _GET_FLAGS, request))[1]
                for wanted in (flags & ~_UP, flags | _UP):
                    ioctl(control_socket, _SET_FLAGS, _REQUEST.pack(name.encode()[:15], wanted))
        except OSError as error:
            raise DeviceUnavailableError(_restart_error(name, error)) from error
        self._close_monitor()

    def _close_monitor(self) -> None:
        if self._monitor is not None:
            self._monitor.close()
            self._monitor = None


def _monitor(name: str) -> socket.socket | None:
    """Return a socket that only reports that the interface was taken down; None if impossible."""
    witness = None
    try:
        witness = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        # An empty list of filters: the socket receives no frame.
        witness.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
        witness.bind((name,))
    except OSError:
        if witness is not None:
            witness.close()
        return None
    return witness


def _restart_error(name: str, error: OSError) -> str:
    what = f"{name} may still hold old frames, which must not be sent now"
    if error.errno in {errno.EPERM, errno.EACCES}:
        return f"{what}: as root, run ip link set {name} down, then ip link set {name} up"
    return f"{what}, and it cannot be taken down: {error}"
