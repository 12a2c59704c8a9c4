"""A CAN interface of the kernel, taken down and up to empty its queue."""

import errno
import socket
import weakref
from fcntl import ioctl
from pathlib import Path
from struct import Struct
from typing import Final, Protocol

from piezod.errors import DeviceUnavailableError

_REQUEST: Final = Struct("16sh22x")  # struct ifreq with the flags of an interface
_GET_FLAGS: Final = 0x8913
_SET_FLAGS: Final = 0x8914
_UP: Final = 1


class Network(Protocol):
    """What is asked of the kernel's interfaces."""

    def times_down(self, name: str) -> int:
        """Tell how often an interface was down, which empties its queue; 0 where unknown."""
        ...

    def restart(self, name: str) -> None:
        """Take an interface down and up.

        Raises:
            DeviceUnavailableError: If this process may not.
        """
        ...


class Kernel:
    """Implements `Network`.

    The kernel counts how often an interface lost its bus, not how often somebody took it down. But
    it tells every socket of the interface: one that hears nothing else is kept for that.
    """

    def __init__(self) -> None:
        self._witness: socket.socket | None = None
        self._taken_down = 0

    def times_down(self, name: str) -> int:
        """Tell how often, since the first call; 0 where the interface is not there."""
        if self._witness is None:
            self._witness = _witness(name)
            if self._witness is not None:
                weakref.finalize(self, self._witness.close)
        elif self._witness.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._taken_down += 1
            self._dismiss()
        try:
            count = Path(f"/sys/class/net/{name}/carrier_down_count").read_text("ascii")
            return int(count) + self._taken_down
        except (OSError, ValueError):
            return self._taken_down

    def restart(self, name: str) -> None:
        """Take an interface down and up; needs CAP_NET_ADMIN.

        Raises:
            DeviceUnavailableError: If this process may not, or there is no such interface.
        """
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
                request = _REQUEST.pack(name.encode()[:15], 0)
                flags = _REQUEST.unpack(ioctl(any_socket, _GET_FLAGS, request))[1]
                for wanted in (flags & ~_UP, flags | _UP):
                    ioctl(any_socket, _SET_FLAGS, _REQUEST.pack(name.encode()[:15], wanted))
        except OSError as error:
            raise DeviceUnavailableError(_refusal(name, error)) from error
        self._dismiss()

    def _dismiss(self) -> None:
        if self._witness is not None:
            self._witness.close()
            self._witness = None


def _witness(name: str) -> socket.socket | None:
    """Return a socket that gets nothing of an interface but that it was taken down."""
    witness = None
    try:
        witness = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        witness.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
        witness.bind((name,))
    except OSError:
        if witness is not None:
            witness.close()
        return None
    return witness


def _refusal(name: str, error: OSError) -> str:
    what = f"{name} may still hold frames that could not leave, and must not send them now"
    if error.errno in {errno.EPERM, errno.EACCES}:
        return f"{what}: as root, ip link set {name} down, then ip link set {name} up"
    return f"{what}, but cannot be taken down: {error}"
