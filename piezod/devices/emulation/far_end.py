"""The device end of an emulated wire: a pty or a TCP port."""

from typing import Protocol


class End(Protocol):
    """The device end of a wire or a bus, which can be unplugged."""

    def place(self) -> str:
        """Return the place at which a driver connects."""
        ...

    def appear(self) -> None:
        """Let drivers connect, at the same place as before.

        Raises:
            DeviceUnavailableError: If the place is taken, or cannot be made.
        """
        ...

    def vanish(self) -> None:
        """Disconnect every client and accept none. Never raises.

        May be called if it is unplugged already.
        """
        ...


class FarEnd(End, Protocol):
    """The device end of a wire."""

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes, as soon as there are any; nothing without a client."""
        ...

    def send(self, data: bytes) -> None:
        """Send as many bytes as the client accepts; none without a client."""
        ...

    def take_connected(self) -> bool:
        """Return once whether a new client has connected, if the end can detect that."""
        ...
