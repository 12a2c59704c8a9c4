"""A CAN interface of the kernel, taken down and up to empty its queue."""

import errno
import socket
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
    """Implements `Network`."""

    def times_down(self, name: str) -> int:
        """Tell it from sysfs; 0 where the interface is not there."""
        try:
            return int(Path(f"/sys/class/net/{name}/carrier_down_count").read_text("ascii"))
        except (OSError, ValueError):
            return 0

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


def _refusal(name: str, error: OSError) -> str:
    what = f"{name} may still hold frames that could not leave, and must not send them now"
    if error.errno in {errno.EPERM, errno.EACCES}:
        return f"{what}: as root, ip link set {name} down, then ip link set {name} up"
    return f"{what}, but cannot be taken down: {error}"
