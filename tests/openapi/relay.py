"""A TCP port of this machine that leads to a unix socket, for programs that know only TCP."""

import selectors
import socket
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar


@contextmanager
def relayed(path: Path) -> Iterator[str]:
    """Yield the URL of a port that leads to a socket while the block runs."""

    class ToSocket(_Handler):
        target = str(path)

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), ToSocket) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}"
        finally:
            server.shutdown()
            thread.join()


class _Handler(socketserver.BaseRequestHandler):
    """Copies the bytes of both directions until one side closes."""

    target: ClassVar[str]

    def handle(self) -> None:
        """Serve one connection."""
        with socket.socket(socket.AF_UNIX) as far, selectors.DefaultSelector() as ready:
            far.connect(self.target)
            ready.register(self.request, selectors.EVENT_READ, far)
            ready.register(far, selectors.EVENT_READ, self.request)
            try:
                while True:
                    for key, _ in ready.select():
                        data = key.fileobj.recv(65536)  # type: ignore[union-attr] # a socket
                        if not data:
                            return
                        key.data.sendall(data)
            except OSError:
                return  # the other side has closed, too
