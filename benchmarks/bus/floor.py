"""The floor: the same bytes by plain system calls, to the same peer."""

import os
import select
import socket
import struct
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, TypeAlias

from benchmarks.bus.cases import Case
from benchmarks.bus.recorded import Exchange

Ask: TypeAlias = Callable[[Exchange], None]


@contextmanager
def serial_floor(line: Any, _where: str, case: Case) -> Iterator[Ask]:
    """Write and read the port of an open line, blocking.

    The end of a line of text is its last byte; other replies have the recorded length.

    Args:
        line: The line, whose connection to its peer is used.
        case: The bus.
    """
    fd = line._fd  # noqa: SLF001 - the same port, without the line's code
    termios.tcflush(fd, termios.TCIFLUSH)
    os.set_blocking(fd, True)
    readable = select.poll()
    readable.register(fd, select.POLLIN)

    def ask(exchange: Exchange) -> None:
        while case.unasked and not exchange.follows and readable.poll(0):
            os.read(fd, 4096)
        os.write(fd, exchange.request)
        _await(lambda: os.read(fd, 4096), exchange.reply, text=case.text)

    try:
        yield ask
    finally:
        os.set_blocking(fd, False)


@contextmanager
def tcp_floor(_line: Any, address: str, case: Case) -> Iterator[Ask]:
    """Send and receive on a connection, blocking."""
    host, _, port = address.rpartition(":")
    with socket.create_connection((host, int(port))) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def ask(exchange: Exchange) -> None:
            connection.send(exchange.request)
            _await(lambda: connection.recv(4096), exchange.reply, text=case.text)

        yield ask


@contextmanager
def udp_floor(_line: Any, address: str, case: Case) -> Iterator[Ask]:
    """Send and receive datagrams of a multicast group, including own ones, blocking."""
    group, _, port = address.removeprefix("udp:").rpartition(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bus:
        bus.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bus.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        bus.bind((group, int(port)))
        member = struct.pack("4sL", socket.inet_aton(group), socket.INADDR_ANY)
        bus.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        own: set[bytes] = set()

        def ask(exchange: Exchange) -> None:
            own.add(exchange.request)
            with suppress(BlockingIOError):
                while case.unasked and not exchange.follows:
                    bus.recv(4096, socket.MSG_DONTWAIT)
            bus.sendto(exchange.request, (group, int(port)))
            wanted = exchange.frames
            while wanted:
                wanted -= bus.recv(4096) not in own

        yield ask


def timed_us(ask: Ask, cycle: Sequence[Exchange], cycles: int) -> list[float]:
    """Return the duration of each of some cycles, in µs."""
    took_us = []
    for _ in range(cycles):
        begin_ns = time.monotonic_ns()
        for exchange in cycle:
            ask(exchange)
        took_us.append((time.monotonic_ns() - begin_ns) / 1e3)
    return took_us


def _await(read: Callable[[], bytes], reply: bytes, *, text: bool) -> None:
    if not reply:
        return
    got = read()
    if text:
        last, wanted = reply[-1:], reply.count(reply[-1:])
        while got.count(last) < wanted:
            got += read()
        return
    while len(got) < len(reply):
        got += read()
