"""Interface of an emulated device, which runs in its own process with a simulated rig behind it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, runtime_checkable

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.faults import WireFaults


class Emulator(Protocol):
    """The device end of a byte stream; never blocks, reads no clock but that of its rig.

    An emulator that inherits from it sends only replies, unless it overrides `due`.
    """

    def receive(self, data: bytes) -> list[bytes]:
        """Process bytes from the host; return the replies one by one.

        Bytes that are no request are answered as the real device does, or not at all; they raise
        nothing.
        """
        ...

    def due(self) -> list[bytes]:
        """Return the unsolicited messages that are due; called every few milliseconds."""
        return []


@runtime_checkable
class HearsConnections(Protocol):
    """An emulator that must know when a client connects over TCP."""

    def connected(self) -> None:
        """Start anew: earlier bytes belong to a closed connection."""
        ...


@runtime_checkable
class Streams(Protocol):
    """An emulator that sends a stream of bytes at a second TCP port."""

    def stream_connected(self) -> None:
        """Start with a whole packet: a client has connected to the second port."""
        ...

    def stream_waiting(self) -> bytes:
        """Return bytes to send at the second port, the same ones until some are sent."""
        ...

    def stream_sent(self, n_bytes: int) -> None:
        """Drop the first of the waiting bytes: the client has accepted them."""
        ...


Serve: TypeAlias = Callable[
    [SharedRig, str, WireFaults, str, Callable[[str], None], Callable[[], bool]], None
]
"""Serves a device at a place until it has to stop; runs in its own thread.

Arguments: the rig; the place, "" for the default; the wire faults; the serial number, "" for the
default; a function to call with the place as soon as clients can connect; and a function, to be
called at least every 0.1 s, that returns whether to stop. Calls `SharedRig.tick` every few
milliseconds while there is no other request to the rig. Raises `DeviceUnavailableError` if the
place is taken or cannot be made.
"""


@dataclass(frozen=True, slots=True)
class EmulatorPlugin:
    """An emulator with the name of its profile, found by the group `piezod.emulators`."""

    name: str  #: Name of the profile, as `piezod emulate` accepts it.
    summary: str  #: One line for lists: the device.
    #: Kind of connection; serial devices are served at a pty, TCP devices at a port.
    wire: Literal["serial", "tcp", "can", "socket"]
    #: Makes the device from its rig, with one axis per channel in order, and its serial number, ""
    #: for the default. None if the wire carries no byte stream.
    create: Callable[[SharedRig, str], Emulator] | None = None
    channels: int = 1  #: Default number of axes of the rig.
    serve: Serve | None = None  #: Serves the device if the wire carries no byte stream.
    #: Distance from the first TCP port to the second one, at which the device sends a stream; 0 if
    #: there is none.
    stream_port: int = 0
