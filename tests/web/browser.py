"""The server of the page in a thread, and what a browser sends to it."""

import asyncio
import json
import socket as sockets
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import ClientConnection, connect

from piezod.web.access import Secrets
from piezod.web.app import create_app
from piezod.web.encryption import Certificate
from piezod.web.public_url import PublicUrl
from piezod.web.server import bind, make_server
from piezod.web.stages import Stages
from tests.daemon.daemons import NO_TLS
from tests.daemon.waiting import join

Document = dict[str, Any]


class Browser:
    """What a browser sends to a server of the page.

    Args:
        port: Its port.
        token: Its token.
    """

    def __init__(self, port: int, token: str) -> None:
        self.port, self.token = port, token
        self.host = f"127.0.0.1:{port}"

    def request(self, method: str, path: str, **headers: str) -> httpx.Response:
        """Send a request without a body; follow no redirection."""
        url = f"http://{self.host}{path}"
        return httpx.request(method, url, headers=headers, verify=NO_TLS, timeout=20)

    def cookie(self) -> str:
        """Exchange the token; return the cookie as a browser sends it."""
        response = self.request("GET", f"/?token={self.token}")
        assert response.status_code == 303
        return response.headers["set-cookie"].partition(";")[0]

    @contextmanager
    def tab(self) -> "Iterator[Tab]":
        """Yield a tab of a browser that has the cookie."""
        with self.socket(cookie=self.cookie()) as connection:
            yield Tab(connection)

    def socket(
        self, *, cookie: str = "", origin: str | None = "own", host: str | None = None
    ) -> ClientConnection:
        """Return an open WebSocket.

        Args:
            cookie: The header `Cookie`.
            origin: The header `Origin`; "own" for that of the page, None for none.
            host: The header `Host`; None for that of the page.
        """
        headers = {"Cookie": cookie} if cookie else {}
        return connect(
            f"ws://{host or self.host}/ws",
            sock=sockets.create_connection(("127.0.0.1", self.port), timeout=20),
            origin=f"http://{self.host}" if origin == "own" else origin,  # type: ignore[arg-type]
            additional_headers=headers,
            max_size=None,
            compression=None,
        )


class Web(Browser):
    """A server of the page on a free port.

    Args:
        find: Returns the sockets of the running daemons.
        certificate: Its certificate; then it listens on all addresses. None for no TLS.
        public: Its address at a reverse proxy; None without one.
    """

    def __init__(
        self,
        find: Callable[[], dict[str, Path]],
        certificate: Certificate | None = None,
        public: PublicUrl | None = None,
    ) -> None:
        self.certificate = certificate
        self.endpoint = bind(
            "0.0.0.0" if certificate else "127.0.0.1",  # noqa: S104 - as other computers need it
            0,
            encrypted=certificate is not None,
        )
        port = self.endpoint.getsockname()[1]
        self.access = Secrets(f"piezod-{port}", public=public)
        super().__init__(port, self.access.tokens.user)
        self._find = find
        self.stages: Stages | None = None

    @contextmanager
    def running(self) -> Iterator[None]:
        """Serve until the end of the block."""
        ready = threading.Event()

        async def serve() -> None:
            self.stages = Stages(f"web:{self.port}", self._find)
            self.server = make_server(create_app(self.stages, self.access), self.certificate)
            ready.set()
            await self.server.serve(sockets=[self.endpoint])

        thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
        with self.endpoint:
            thread.start()
            ready.wait()
            try:
                yield
            finally:
                self.server.should_exit = True
                join(thread)


class Tab:
    """A page: it sends messages and keeps the events.

    Args:
        connection: Its WebSocket.
    """

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.events: list[Document] = []
        self._answers: dict[int | None, Document] = {}
        self._number = 0

    def send(self, **message: Any) -> int:
        """Send a message; return its number."""
        self._number += 1
        self.connection.send(json.dumps({"id": self._number, **message}))
        return self._number

    def ask(self, **message: Any) -> Document:
        """Send a message; return its answer."""
        return self.answer(self.send(**message))

    def call(
        self, path: str, body: Document | None = None, method: str = "POST", stage: str = "bench"
    ) -> Document:
        """Call an endpoint of a stage; return the answer."""
        return self.ask(do="call", stage=stage, method=method, path=path, body=body)

    def answer(self, number: int | None) -> Document:
        """Return the answer with a number."""
        while number not in self._answers:
            self.read()
        return self._answers.pop(number)

    def event(self, kind: str, **fields: Any) -> Document:
        """Return the first event of a kind with these fields; drop it and all before."""
        while True:
            while self.events:
                event = self.events.pop(0)
                if event["event"] == kind and fields.items() <= event.items():
                    return event
            self.read()

    def read(self) -> None:
        """Read one message of the server."""
        message = json.loads(self.connection.recv(timeout=20))
        if "event" in message:
            self.events.append(message)
        else:
            self._answers[message["id"]] = message


def close_code(connection: ClientConnection) -> int:
    """Wait until the server closes a WebSocket; return the code."""
    with suppress(ConnectionClosedError):
        for _ in connection:
            pass
    return connection.close_code or 0
