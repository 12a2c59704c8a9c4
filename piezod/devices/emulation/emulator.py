"""The far end of a wire: a device that exists in a process of its own, with physics behind it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from piezod.devices.emulation.bench import Bench


class Emulator(Protocol):
    """A device's end of a stream of bytes; never blocks, looks at no clock but its bench's."""

    def receive(self, data: bytes) -> list[bytes]:
        """Take what has come from the host; return what is answered, each reply on its own.

        Bytes that are no request are answered as the device does, or not at all; they raise nothing.
        """
        ...

    def due(self) -> list[bytes]:
        """Return what the device sends unasked by now; called every few milliseconds."""
        ...


@dataclass(frozen=True, slots=True)
class EmulatorPlugin:
    """What leads from the name of a profile to its emulator, by the group `piezod.emulators`.

    Attributes:
        name: Of the profile, as `piezod emulate` takes it.
        summary: One line for lists: which device it is.
        wire: What it is connected by; serial ones are served at a pty, tcp ones at a port.
        create: Makes the device: its bench, with an axis for each of its channels in order, and the
            serial number that it tells, "" for its usual one.
        channels: How many axes the bench has unless told otherwise.
    """

    name: str
    summary: str
    wire: Literal["serial", "tcp"]
    create: Callable[[Bench, str], Emulator]
    channels: int = 1
