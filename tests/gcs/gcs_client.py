"""A plain client of a GCS controller over TCP."""

import re
import socket
from types import TracebackType
from typing import Final, Self

WHOLE: Final = re.compile(rb"(?<! )\n$")


class GcsClient:
    """A connection; also a context manager.

    Args:
        port: TCP port of the controller.
    """

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=20)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._socket.close()

    def ask(self, query: str) -> str:
        """Send a query, a single byte without line feed; return its reply without line feed."""
        self._socket.sendall(query.encode("latin-1") + (b"\n" if len(query) > 1 else b""))
        reply = b""
        while not WHOLE.search(reply):
            received = self._socket.recv(4096)
            assert received, "the controller has closed the connection"
            reply += received
        return reply.decode("cp1252").strip()

    def do(self, command: str) -> int:
        """Send a command without reply; return its error."""
        self._socket.sendall(command.encode("latin-1") + (b"\n" if len(command) > 1 else b""))
        return int(self.ask("ERR?"))

    def closed(self) -> bool:
        """Wait until the controller closes the connection; return whether it did so in silence."""
        try:
            return self._socket.recv(4096) == b""
        except ConnectionResetError:
            return True

    def send(self, data: bytes) -> None:
        """Send bytes."""
        self._socket.sendall(data)
