"""Clients that flood the service of a stage that moves."""

import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Event

import pytest

from tests.chaos.conftest import ChaosStage
from tests.daemon.service.raw import HEAD
from tests.daemon.waiting import eventually

pytestmark = [pytest.mark.chaos, pytest.mark.fault("C2")]

CONNECTIONS = 200
GROWN_MB = 40.0
REQUEST = b"GET /v1/status HTTP/1.1\r\nhost: piezod\r\n\r\n"


def connect(path: Path, sent: bytes) -> socket.socket:
    """Open a connection, and send something if the other end takes it."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(5.0)
    with suppress(OSError):
        connection.connect(str(path))
        connection.sendall(sent)
    return connection


@contextmanager
def idle(path: Path, sent: bytes) -> Iterator[None]:
    """Hold many connections that have sent this, and read nothing."""
    with ExitStack() as stack:
        for _ in range(CONNECTIONS):
            stack.enter_context(connect(path, sent))
        yield


@contextmanager
def requests(path: Path, sent: bytes) -> Iterator[None]:
    """Send requests as fast as eight clients can."""
    over = Event()

    def ask() -> None:
        while not over.is_set():
            with connect(path, sent) as connection, suppress(OSError):
                while connection.recv(4096) and not over.is_set():
                    connection.sendall(sent)

    with ThreadPoolExecutor(8) as beside:
        for _ in range(8):
            beside.submit(ask)
        try:
            yield
        finally:
            over.set()


FLOODS = {
    "connections that send nothing": (idle, b""),
    "requests that never end": (idle, HEAD % b"goto"),
    "answers that are not read": (idle, REQUEST * 500),
    "headers without an end": (idle, b"GET / HTTP/1.1\r\nx: " + b"x" * 10**6),
    "bodies that are too large": (
        idle,
        HEAD % b"wave" + b"content-length: 9999999\r\n\r\n" + b" " * 10**6,
    ),
    "requests": (requests, REQUEST),
    "bytes that are not HTTP": (requests, b"\0" * 100),
}


def descriptors(pid: int) -> int:
    """Return how many descriptors a process has."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process, in MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


@pytest.mark.parametrize("name", FLOODS)
def test_flood_neither_stops_the_stage_nor_the_emergency_stop(stage: ChaosStage, name: str) -> None:
    """The stage moves on, an emergency stop is executed, and the service is as before.

    Only a machine that was too busy for the loop before the flood may hold the stage; nothing
    excuses the emergency stop.
    """
    flood, sent = FLOODS[name]
    daemon = stage.daemon
    stage.bring("RUN")
    pid = daemon.process.pid
    was_late = stage.was_late()
    descriptors_before, mb_before = descriptors(pid), resident_mb(pid)
    with flood(daemon.paths.api_socket, sent):
        cycles = len(stage.writes())
        eventually(lambda: len(stage.writes()) > cycles + 40 or stage.idle(), 60.0)
        moved = len(stage.writes()) > cycles + 40
        stopped = daemon.command("estop", "--stage", daemon.paths.name)
    daemon.until("FAULT", 60.0)
    eventually(lambda: descriptors(pid) <= descriptors_before)
    mb_after = resident_mb(pid)
    eventually(lambda: daemon.ask("POST", "reset", {}).status_code == 200)
    daemon.do("shutdown")

    assert moved or was_late, daemon.text
    assert stopped.returncode == 0, stopped.stderr
    assert "fault=E1" in daemon.text
    assert daemon.exit_code() == 0, daemon.text
    assert mb_after < mb_before + GROWN_MB
    stage.assert_ended()
