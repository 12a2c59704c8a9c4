"""The bytes of one cycle, as a driver exchanges them with its device."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.bus.tcp_line import TcpLine


class Exchange(NamedTuple):
    """A request, and what came back.

    Attributes:
        request: The bytes that were sent.
        reply: The bytes that came; empty where there is no reply.
    """

    request: bytes
    reply: bytes


@contextmanager
def recording() -> Iterator[list[Exchange]]:
    """Collect what goes over lines while the block runs."""
    exchanges: list[Exchange] = []
    before = [(line, line.send, line.receive) for line in (SerialLine, TcpLine)]
    for line, send, receive in before:
        _watch(line, send, receive, exchanges)
    try:
        yield exchanges
    finally:
        for line, send, receive in before:
            setattr(line, "send", send)  # noqa: B010 - a method is put back
            setattr(line, "receive", receive)  # noqa: B010 - likewise


def _watch(line: type[Any], send: Any, receive: Any, exchanges: list[Exchange]) -> None:
    def sending(self: object, data: bytes) -> None:
        exchanges.append(Exchange(bytes(data), b""))
        send(self, data)

    def receiving(self: object, within_ns: int) -> bytes:
        data: bytes = receive(self, within_ns)
        if data and exchanges:
            last = exchanges[-1]
            exchanges[-1] = last._replace(reply=last.reply + data)
        return data

    line.send, line.receive = sending, receiving
