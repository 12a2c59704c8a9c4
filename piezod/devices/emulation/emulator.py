"""The far end of a wire: a device that exists in a process of its own, with physics behind it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, runtime_checkable

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.faults import WireFaults


class Emulator(Protocol):
    """A device's end of a stream of bytes; never blocks, looks at no clock but its bench's."""

    def receive(self, data: bytes) -> list[bytes]:
        """Take what has come from the host; return what is answered, each reply on its own.

        Bytes that are no request are answered as the device does, or not at all; they raise
        nothing.
        """
        ...

    def due(self) -> list[bytes]:
        """Return what the device sends unasked by now; called every few milliseconds."""
        ...


@runtime_checkable
class HearsConnections(Protocol):
    """An emulator that wants to know when somebody connects over TCP."""

    def connected(self) -> None:
        """Begin anew: what came before belongs to a connection that is gone."""
        ...


Serve: TypeAlias = Callable[
    [SharedRig, str, WireFaults, str, Callable[[str], None], Callable[[], bool]], None
]
"""Serves a device at a place until told to stop; runs in a thread of its own.

Called with the bench; the place, "" for the usual one; what goes wrong on the wire; the serial
number, "" for the usual one; what is told the place as soon as somebody can connect there; and
what tells, asked at least every 0.1 s, that it is time to stop. Calls `SharedRig.tick` every few
milliseconds where nothing else is asked of the bench. Raises `DeviceUnavailableError` where the
place is taken or cannot be made.
"""


@dataclass(frozen=True, slots=True)
class EmulatorPlugin:
    """What leads from the name of a profile to its emulator, by the group `piezod.emulators`.

    Attributes:
        name: Of the profile, as `piezod emulate` takes it.
        summary: One line for lists: which device it is.
        wire: What it is connected by; serial ones are served at a pty, tcp ones at a port.
        create: Makes the device: its bench, with an axis for each of its channels in order, and the
            serial number that it tells, "" for its usual one. None where the wire carries no stream
            of bytes.
        channels: How many axes the bench has unless told otherwise.
        serve: Serves it where the wire carries no stream of bytes.
    """

    name: str
    summary: str
    wire: Literal["serial", "tcp", "can", "socket"]
    create: Callable[[SharedRig, str], Emulator] | None = None
    channels: int = 1
    serve: Serve | None = None
