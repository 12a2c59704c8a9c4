"""The bare minimum: the same bytes by plain system calls, to the same peer."""

import os
import socket
import termios
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeAlias

from benchmarks.bus.recorded import Exchange

Ask: TypeAlias = Callable[[Exchange], None]


@contextmanager
def serial_floor(port: str, *, text: bool) -> Iterator[Ask]:
    """Write and read a port, blocking.

    Args:
        port: Its path.
        text: Whether replies are lines of any length, counted by their last byte; else they have
            the length they had.
    """
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(fd)
        termios.tcflush(fd, termios.TCIOFLUSH)

        def ask(exchange: Exchange) -> None:
            os.write(fd, exchange.request)
            _await(lambda: os.read(fd, 4096), exchange.reply, text=text)

        yield ask
    finally:
        os.close(fd)


@contextmanager
def tcp_floor(address: str, *, text: bool) -> Iterator[Ask]:
    """Send and receive on a connection, blocking."""
    host, _, port = address.rpartition(":")
    with socket.create_connection((host, int(port))) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def ask(exchange: Exchange) -> None:
            connection.send(exchange.request)
            _await(lambda: connection.recv(4096), exchange.reply, text=text)

        yield ask


def timed_us(ask: Ask, cycle: Sequence[Exchange], cycles: int) -> list[float]:
    """Return how long each of some cycles took, in µs."""
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
