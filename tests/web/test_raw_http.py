"""The requests and answers of docs/how-to/http.md, byte by byte."""

import re
import socket
from contextlib import closing
from typing import Final

import pytest

from piezod.messages import requests
from tests.daemon.service.fakes import Served
from tests.docs.blocks import ROOT
from tests.web.browser import Web

PAGE: Final = (ROOT / "docs" / "how-to" / "http.md").read_text(encoding="utf-8")
GOTO, ACCEPTED, STATUS, REFUSED = re.findall(r"^```http\n(.*?)\n```$", PAGE, re.M | re.S)
DATE: Final = re.compile(rb"^date: .*\r$", re.MULTILINE)


def as_bytes(text: str) -> bytes:
    """Return a message of the page as a program sends it."""
    header, _, body = text.partition("\n\n")
    return f"{header.rstrip()}\n\n".replace("\n", "\r\n").encode() + body.encode()


def exchanged(connection: socket.socket, request: bytes) -> bytes:
    """Send a request; return the answer, read as the page says."""
    connection.sendall(request)
    answer = b""
    while b"\r\n\r\n" not in answer:
        answer += connection.recv(1)
    length = int(answer.partition(b"content-length: ")[2].split()[0])
    while length:
        body = connection.recv(length)
        length -= len(body)
        answer += body
    return DATE.sub(b"date:\r", answer)


@pytest.fixture
def moving(daemon: Served) -> Served:
    """Return the daemon of a stage that moves."""
    daemon.stage.state = "RUN"
    return daemon


def test_over_tcp(web: Web, moving: Served) -> None:
    """Requests in plain text get the answers of the page, over one connection."""
    goto, status = (
        as_bytes(each).replace(b"TOKEN", web.access.tokens.user.encode()) for each in (GOTO, STATUS)
    )
    with closing(socket.create_connection(("127.0.0.1", web.port), 20.0)) as connection:
        accepted = exchanged(connection, goto)
        looked = exchanged(connection, status)
        moving.stage.refusal = "cannot move in SAFE"
        refused = exchanged(connection, goto)

    assert accepted == DATE.sub(b"date:\r", as_bytes(ACCEPTED))
    assert refused == DATE.sub(b"date:\r", as_bytes(REFUSED))
    assert b'"state":"RUN"' in looked
    assert moving.stage.requests == [requests.Goto(position_um=12.5)]


def test_over_the_socket(moving: Served) -> None:
    """The socket of the stage gives the same answers, without a token."""
    request = as_bytes(re.sub(r"Authorization: .*\n", "", GOTO))
    with closing(socket.socket(socket.AF_UNIX)) as connection:
        connection.settimeout(20.0)
        connection.connect(str(moving.socket))
        accepted = exchanged(connection, request)

    assert accepted.partition(b"\r\n\r\n")[2] == as_bytes(ACCEPTED).partition(b"\r\n\r\n")[2]
    assert moving.stage.requests == [requests.Goto(position_um=12.5)]
