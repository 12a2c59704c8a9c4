"""Interface of an emulated device, which runs in its own process with a simulated rig behind it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, runtime_checkable

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.faults import WireFaults


class Emulator(Protocol):
    """The device end of a byte stream; never blocks, reads no clock but that of its rig."""

    def receive(self, data: bytes) -> list[bytes]:
        """Process bytes from the host; return the replies one by one.

        Bytes that are no request are answered as the real device does, or not at all; they raise
        nothing.
        """
        ...

    def due(self) -> list[bytes]:
        """Return the unsolicited messages that are due; called every few milliseconds."""
        ...


@runtime_checkable
class HearsConnections(Protocol):
    """An emulator that must know when a client connects over TCP."""

    def connected(self) -> None:
        """Start anew: earlier bytes belong to a closed connection."""
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
    """An emulator with the name of its profile, found by the group `piezod.emulators`.

    Attributes:
        name: Name of the profile, as `piezod emulate` accepts it.
        summary: One line for lists: the device.
        wire: Kind of connection; serial devices are served at a pty, TCP devices at a port.
        create: Makes the device from its rig, with one axis per channel in order, and its serial
            number, "" for the default. None if the wire carries no byte stream.
        channels: Default number of axes of the rig.
        serve: Serves the device if the wire carries no byte stream.
    """

    name: str
    summary: str
    wire: Literal["serial", "tcp", "can", "socket"]
    create: Callable[[SharedRig, str], Emulator] | None = None
    channels: int = 1
    serve: Serve | None = None
