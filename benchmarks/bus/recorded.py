"""The bytes of one cycle, as a driver exchanges them with its device."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import can
from can.interfaces.udp_multicast.utils import pack_message

from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.bus.tcp_line import TcpLine
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.library_bus import LibraryBus


class Exchange(NamedTuple):
    """A request and its reply."""

    request: bytes  #: The sent bytes.
    reply: bytes = b""  #: The received bytes; empty without a reply.
    frames: int = 0  #: Number of received pieces; on a CAN bus these are frames.
    follows: bool = False  #: Whether it was sent without waiting after the one before.

    def with_reply(self, data: bytes) -> "Exchange":
        """Return it with more bytes of its reply."""
        return self._replace(reply=self.reply + data, frames=self.frames + 1)


class Recorded(list[Exchange]):
    """The bytes on a line."""

    line: Any = None  #: The line.


@contextmanager
def recording() -> Iterator[Recorded]:
    """Record the bytes on lines and on a CAN bus over UDP while the block runs."""
    exchanges = Recorded()
    before = [(kind, kind.send, kind.receive) for kind in (SerialLine, TcpLine, LibraryBus)]
    for kind, send, receive in before:
        _watch(kind, send, receive, exchanges)
    try:
        yield exchanges
    finally:
        for kind, send, receive in before:
            setattr(kind, "send", send)  # noqa: B010 - a method is put back
            setattr(kind, "receive", receive)  # noqa: B010 - likewise


def _watch(kind: type[Any], send: Any, receive: Any, exchanges: Recorded) -> None:
    def sending(self: object, data: bytes | Frame) -> None:
        exchanges.line = self
        follows = bool(exchanges) and not exchanges[-1].reply
        exchanges.append(Exchange(_bytes(data), follows=follows))
        send(self, data)

    def receiving(self: object, within_ns: int) -> bytes | Frame | None:
        data: bytes | Frame | None = receive(self, within_ns)
        if data and exchanges:
            exchanges[-1] = exchanges[-1].with_reply(_bytes(data))
        return data

    kind.send, kind.receive = sending, receiving


def _bytes(data: bytes | Frame) -> bytes:
    if isinstance(data, Frame):
        message = can.Message(
            arbitration_id=data.id, data=data.data, is_extended_id=data.extended, is_fd=False
        )
        return bytes(pack_message(message))
    return bytes(data)
