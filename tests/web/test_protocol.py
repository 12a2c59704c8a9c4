"""Connections on which no browser talks."""

import asyncio
import socket
from collections.abc import Iterator
from typing import cast

import pytest
from starlette.websockets import WebSocket
from websockets.frames import Frame, Opcode

from piezod.messages.endpoints import Role
from piezod.web import protocol
from piezod.web.stages import Stages
from piezod.web.tab import Tab
from tests.daemon.service.raw import read_to_end
from tests.web.browser import Web, close_code


@pytest.fixture
def raw(web: Web) -> Iterator[socket.socket]:
    """Yield a connection on which nothing was sent."""
    with socket.create_connection(("127.0.0.1", web.port), timeout=20.0) as connection:
        yield connection


def test_connection_without_a_request_is_closed(web: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    """A half request ends after the limit of time; a WebSocket lasts longer than that."""
    monkeypatch.setattr(protocol, "REQUEST_S", 0.1)
    with (
        socket.create_connection(("127.0.0.1", web.port), timeout=20.0) as limited,
        web.tab() as tab,
    ):
        limited.sendall(b"GET / HTTP/1.1\r\nHost: loc")
        assert read_to_end(limited) == b""
        tab.ask(do="watch", stage="bench")
        for _ in range(10):
            tab.event("telemetry")


@pytest.mark.parametrize(
    "data",
    [
        b"hello\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"POST / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        b"GET / HTTP/1.1\r\n" + b"x: y\r\n" * 5000,
    ],
)
def test_data_that_is_not_http_fills_no_log(
    raw: socket.socket, data: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    """The connection is refused and closed, and nothing is logged about it."""
    raw.sendall(data)

    assert read_to_end(raw).startswith(b"HTTP/1.1 4")
    assert not caplog.records


def test_frame_that_is_not_allowed_ends_the_tab(web: Web, caplog: pytest.LogCaptureFixture) -> None:
    """The tab is closed in the middle of its telemetry, nothing is logged, and others go on."""
    with web.tab() as tab, web.tab() as other:
        tab.ask(do="watch", stage="bench")
        tab.event("telemetry")
        unmasked = Frame(Opcode.TEXT, b"{}").serialize(mask=False)
        tab.connection.socket.sendall(unmasked)
        assert close_code(tab.connection) == 1002
        assert other.ask(do="stages")["ok"]
    assert not [record for record in caplog.records if record.name.startswith("uvicorn")]


class ClosedSocket:
    """A WebSocket that the server has closed after a frame that is not allowed."""

    async def send_text(self, _text: str) -> None:
        raise RuntimeError("Unexpected ASGI message 'websocket.send'")

    async def receive(self) -> None:
        await asyncio.Event().wait()


def test_text_for_a_closed_socket_ends_the_tab() -> None:
    """What comes after the end of a WebSocket is no internal error."""

    async def run() -> None:
        tab = Tab("tab", cast("WebSocket", ClosedSocket()), Stages("web", dict), Role.VIEWER)
        tab.put("{}")
        await tab.run()

    asyncio.run(run())
