"""Raw connections, for requests that no HTTP client sends."""

import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HEAD = b"POST /v1/%s HTTP/1.1\r\nhost: piezod\r\nx-piezod-client: raw\r\n"


@contextmanager
def connected(path: Path) -> Iterator[socket.socket]:
    """Yield a connection on which nothing was sent."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(20.0)
        connection.connect(str(path))
        yield connection


def read_to_end(connection: socket.socket) -> bytes:
    """Return all data until the other end closes."""
    found = b""
    while chunk := _receive(connection):
        found += chunk
    return found


def _receive(connection: socket.socket) -> bytes:
    try:
        return connection.recv(65536)
    except ConnectionResetError:  # it closed with something of ours unread
        return b""


def wait_for_hang_up(connection: socket.socket) -> None:
    """Wait until the other end has closed, without reading."""
    poll = select.poll()
    poll.register(connection, 0)  # POLLHUP is always told
    assert poll.poll(20_000), "the connection is still open"
