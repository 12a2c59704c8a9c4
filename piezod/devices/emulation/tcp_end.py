"""A TCP port as the device end of a connection."""

import select
import socket
from contextlib import suppress
from typing import Final

from piezod.errors import DeviceUnavailableError

_MOST_BYTES: Final = 65_536


class TcpEnd:
    """Implements `FarEnd` over TCP: serves one client at a time and refuses others.

    Args:
        host: Address to listen at.
        port: Port number; 0 for any.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        self._poll = select.poll()
        self._connected = False

    def place(self) -> str:
        """Address and port."""
        return f"{self._host}:{self._port}"

    def appear(self) -> None:
        """Listen; after the first time always at the same port.

        Raises:
            DeviceUnavailableError: If the port is taken, or the address does not exist.
        """
        try:
            self._listener = socket.create_server((self._host, self._port))
        except (OSError, OverflowError) as error:
            raise DeviceUnavailableError(f"cannot listen at {self.place()}: {error}") from error
        self._listener.setblocking(False)
        self._port = self._listener.getsockname()[1]  # the chosen one if it was 0
        self._poll = select.poll()
        self._poll.register(self._listener, select.POLLIN)

    def vanish(self) -> None:
        """Close the connection and stop listening."""
        if self._listener is not None:
            self._poll.unregister(self._listener)
            self._listener.close()
            self._listener = None
        self._drop()

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes, as soon as there are any; accept clients meanwhile."""
        data = b""
        for fd, _ in self._poll.poll(within_ns / 1e6):
            if self._client is not None and fd == self._client.fileno():
                data = self._read(self._client)
            else:
                self._accept()
        return data

    def send(self, data: bytes) -> None:
        """Send as many bytes as there is room for; none if no client is connected."""
        self.send_some(data)

    def send_some(self, data: bytes) -> int:
        """Send as many bytes as there is room for; return their number."""
        if self._client is not None:
            with suppress(BlockingIOError):
                try:
                    return self._client.send(data)
                except (ConnectionError, TimeoutError):
                    self._drop()
        return 0

    def take_connected(self) -> bool:
        """Return once whether a new client has connected."""
        connected, self._connected = self._connected, False
        return connected

    def _accept(self) -> None:
        if self._listener is None:
            return
        try:
            client, _ = self._listener.accept()
        except OSError:  # the client has disconnected already
            return
        # A real device serves one client; one that has left is noticed only by looking.
        if self._client is not None and not _has_gone(self._client):
            client.close()
            return
        self._drop()
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._connected = client, True
        self._poll.register(client, select.POLLIN)

    def _read(self, client: socket.socket) -> bytes:
        try:
            data = client.recv(_MOST_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop()
        return data

    def _drop(self) -> None:
        if self._client is not None:
            self._poll.unregister(self._client)
            self._client.close()
            self._client = None


def _has_gone(client: socket.socket) -> bool:
    """Return whether a client has closed its end and left no unread bytes."""
    try:
        return client.recv(1, socket.MSG_PEEK) == b""  # end of file; peeking takes nothing away
    except BlockingIOError:
        return False
    except OSError:
        return True
