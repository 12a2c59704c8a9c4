"""Connections from real addresses, with and without `--allow`."""

import os
import re
import socket
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

import pytest

from tests.addresses import ELSEWHERE, address_outside
from tests.client.fake_daemon import FakeDaemon
from tests.daemon.waiting import eventually
from tests.forked import Forked

LOOPBACK: Final = "127.0.0.1"


class Server:
    """A `piezod gcs` process.

    Args:
        port: Its TCP port.
        printed: File with its output and its errors.
    """

    def __init__(self, port: int, printed: Path) -> None:
        self.port, self._printed = port, printed

    @property
    def text(self) -> str:
        """What it has printed."""
        return self._printed.read_text(encoding="utf-8")

    def answer(self, source: str, to: str) -> str:
        """Connect and ask for the identity; return the reply, empty if the connection is closed.

        Args:
            source: Address of this computer that the connection is from.
            to: Address of this computer that it goes to.
        """
        with closing(socket.create_connection((to, self.port), 20.0, (source, 0))) as connection:
            try:
                connection.sendall(b"*IDN?\n")
                return connection.recv(4096).decode()
            except (BrokenPipeError, ConnectionResetError):
                return ""


@contextmanager
def served(*options: str) -> Iterator[Server]:
    """Run `piezod gcs` with these options while the block runs."""
    with tempfile.TemporaryDirectory(prefix="pz-") as name, (Path(name) / "out").open("wb") as out:
        daemon = FakeDaemon(Path(name) / "api.sock")
        arguments = ("gcs", "--port", "0", "--socket", str(daemon.socket_path), *options)
        with daemon.running(), Path(os.devnull).open("rb") as nothing:
            process = Forked(arguments, (nothing.fileno(), out.fileno(), out.fileno()))
            try:
                announced = eventually(lambda: port_in(Path(out.name)))
                yield Server(announced, Path(out.name))
            finally:
                process.terminate()
                code = process.wait(20.0)
    assert code == 0


def port_in(printed: Path) -> int:
    """Return the TCP port that the server has printed; 0 if it has not."""
    match = re.search(r"GCS 2 at 127\.0\.0\.1:(\d+)", printed.read_text(encoding="utf-8"))
    return int(match[1]) if match else 0


@pytest.fixture
def outside() -> str:
    """Return the address of this computer in its network; a connection from it is no loopback."""
    return address_outside()


def test_address_that_is_not_allowed_gets_nothing(outside: str) -> None:
    """Its connection is closed without an answer to what it sends, and the refusal is printed."""
    with served("--allow", ELSEWHERE) as server:
        refused = server.answer(outside, to=outside)
        own = server.answer("127.0.0.3", to=LOOPBACK)
        text = f"refused a connection: {outside} is not allowed: name it with --allow"
        eventually(lambda: text in server.text)

    assert refused == ""
    assert own.startswith("(c)2026 piezod")


def test_allowed_address_is_answered(outside: str) -> None:
    """A computer that is named with `--allow` may use the stage."""
    with served("--allow", ELSEWHERE, "--allow", outside) as server:
        assert server.answer(outside, to=outside).startswith("(c)2026 piezod")


def test_other_computers_reach_nothing_unless_one_is_allowed(outside: str) -> None:
    """Without the option nothing listens on the network."""
    with served() as server:
        with pytest.raises(ConnectionRefusedError):
            server.answer(outside, to=outside)
        for source in (LOOPBACK, "127.0.0.3"):
            assert server.answer(source, to=LOOPBACK).startswith("(c)2026 piezod")
