"""A daemon on a real socket, with answers that a test sets."""

import json
import socketserver
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any, NamedTuple

Document = dict[str, Any]

ACCEPTED = {"accepted": True, "motion": 7}


class Asked(NamedTuple):
    """A received request."""

    what: str  #: Method and path with its query, for example "GET status".
    body: Any  #: The document, or the documents of the lines; None for none.
    client: str  #: Name of the client.


class Raw(NamedTuple):
    """An answer that is not a document."""

    status: int  #: HTTP status.
    body: bytes  #: Content.
    kind: str = "application/json"  #: Media type.


class FakeDaemon(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    """Records requests; answers them from `answers`, by method and path, while `answering` is set.

    Args:
        socket: Path of its socket.
    """

    def __init__(self, socket: Path) -> None:
        super().__init__(str(socket), _Handler)
        self.socket_path = socket
        self.asked: list[Asked] = []
        self.answers: dict[str, Document | Raw] = {"GET status": STATUS}
        self.telemetry: list[Document] = []
        self.lasting = False
        """Whether telemetry lasts, with the last interval again and again."""
        self.answering, self.ending = threading.Event(), threading.Event()
        self.answering.set()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Serve until the end of the block."""
        thread = threading.Thread(target=self.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield
        finally:
            self.answering.set()
            self.ending.set()
            self.shutdown()
            thread.join()
            self.server_close()
            self.socket_path.unlink()

    def handle_error(self, request: object, client_address: object) -> None:
        """Print nothing about a client that has disconnected."""

    def refuse(self, what: str, status: int, code: str, text: str, remedy: str = "") -> None:
        """Answer a request with an error from now on."""
        document = {"error": {"code": code, "what": text, "remedy": remedy}}
        self.answers[what] = Raw(status, json.dumps(document).encode())


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: FakeDaemon

    def do_GET(self) -> None:
        self._handle(None)

    def do_DELETE(self) -> None:
        self._handle(None)

    def do_POST(self) -> None:
        if self.headers.get("Transfer-Encoding") == "chunked":
            self._handle([json.loads(line) for line in b"".join(self._chunks()).splitlines()])
        else:
            length = int(self.headers.get("Content-Length", "0"))
            self._handle(json.loads(self.rfile.read(length) or b"null"))

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing."""

    def _chunks(self) -> Iterator[bytes]:
        while size := int(self.rfile.readline(), 16):
            yield self.rfile.read(size)
            self.rfile.readline()
        self.rfile.readline()

    def _handle(self, body: Any) -> None:
        what = f"{self.command} {self.path.removeprefix('/v1/')}"
        self.server.asked.append(Asked(what, body, self.headers["X-Piezod-Client"]))
        self.server.answering.wait()
        if what.startswith("GET telemetry") and self.server.lasting:
            self._stream()
            return
        answer = self.server.answers.get(what.partition("?")[0], ACCEPTED)
        if what.startswith("GET telemetry") and self.server.telemetry:
            answer = Raw(200, events(self.server.telemetry), "text/event-stream")
        if not isinstance(answer, Raw):
            answer = Raw(200, json.dumps(answer).encode())
        self.send_response(answer.status)
        self.send_header("Content-Type", answer.kind)
        self.send_header("Content-Length", str(len(answer.body)))
        self.end_headers()
        self.wfile.write(answer.body)

    def _stream(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Connection", "close")
        self.end_headers()
        sent = 0
        while self.server.lasting and not self.server.ending.wait(0.01):
            last = len(self.server.telemetry) - 1
            self.wfile.write(events([self.server.telemetry[min(sent, last)]]))
            sent += 1


def events(documents: Sequence[Document]) -> bytes:
    """Return documents as an event stream, with comments between them."""
    texts = (
        f"event: telemetry\ndata: {json.dumps(each)}\n\n: nothing new\n\n" for each in documents
    )
    return "".join(texts).encode()


def ranged(value: float | None) -> Document:
    """Return a quantity that is constant in an interval."""
    return {"min": value, "max": value, "last": value}


def interval(
    position_um: float | None = 12.4,
    *,
    state: str = "RUN",
    motion: int = 7,
    on_target: bool = False,
    faults: Sequence[str] = (),
    axis: str = "x",
    t_s: float = 100.0,
) -> Document:
    """Return the telemetry of an interval with constant quantities."""
    error_um = None if position_um is None else 12.5 - position_um
    return {
        "t_s": t_s,
        "cycles": 50,
        "lost": 0,
        "state": state,
        "shadow": False,
        "faults": list(faults),
        "skipped_cycles": 3,
        "late_max_us": 20.0,
        "axes": {
            axis: {
                "mode": "adaptive",
                "on_target": on_target,
                "motion": motion,
                "target_um": 12.5,
                "position_um": ranged(position_um),
                "command_um": ranged(12.5),
                "drive_v": ranged(60.0),
                "error_um": ranged(error_um),
            }
        },
    }


STATUS: Document = {
    "stage": "simulated",
    "title": "A stage",
    "state": "RUN",
    "mode": "adaptive",
    "shadow": False,
    "faults": [
        {"id": "S5", "name": "stuck", "present": True, "latched": False, "remedy": "look at it"}
    ],
    "skipped_cycles": 3,
    "axes": {
        "x": {
            "position_um": 12.4,
            "command_um": 12.5,
            "drive_v": 60.0,
            "target_um": 12.5,
            "mode": "adaptive",
            "on_target": True,
            "motion": 7,
        }
    },
}
