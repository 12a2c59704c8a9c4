"""Where an emulated device's wire ends: what a host of one does with a pty or a TCP port."""

from typing import Protocol


class End(Protocol):
    """The device's end of a wire or a bus, which can be pulled out."""

    def place(self) -> str:
        """Tell where a driver connects."""
        ...

    def appear(self) -> None:
        """Be there for drivers to connect, at the same place as before.

        Raises:
            DeviceUnavailableError: If the place is taken, or cannot be made.
        """
        ...

    def vanish(self) -> None:
        """Be pulled out: whoever is connected is no longer, nobody can connect. Never raises.

        May be called where it is out already.
        """
        ...


class FarEnd(End, Protocol):
    """The device's end of a wire."""

    def receive(self, within_ns: int) -> bytes:
        """Return what has come, as soon as something has; nothing where nobody is connected."""
        ...

    def send(self, data: bytes) -> None:
        """Send as much of this as the other end takes; nothing where nobody is connected."""
        ...

    def take_connected(self) -> bool:
        """Tell once that somebody new has connected, where that can be told."""
        ...
