"""A TCP connection as a `Line`."""

import select
import socket
import time
from contextlib import suppress
from errno import ETIMEDOUT
from typing import Final

from piezod.devices.bus.byte_trace import trace_received, trace_sent
from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError

_MOST_BYTES: Final = 65_536
_SEND_NS: Final = 50_000_000
"""Longest time to put a request into the kernel's buffer; only a dead device lets it fill."""
_CONNECT_S: Final = 2.0
_UNACKNOWLEDGED_S: Final = 1.0
"""Short, because the kernel's own limit is about 15 minutes."""


class TcpLine:
    """Implements `Line` over a TCP connection.

    Requests are sent without delay. The connection is closed if the peer does not acknowledge sent
    bytes in time.

    Args:
        host: Name or address.
        port: Port number.
        connect_s: Time-out of `open`, in s.
        unacknowledged_s: Longest time without acknowledgement of sent bytes, in s.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        connect_s: float = _CONNECT_S,
        unacknowledged_s: float = _UNACKNOWLEDGED_S,
    ) -> None:
        self._host, self._port = host, port
        self._connect_s, self._unacknowledged_s = connect_s, unacknowledged_s
        self._socket: socket.socket | None = None
        self._readable = self._writable = select.poll()

    @property
    def where(self) -> str:
        """Address and port."""
        return f"{self._host}:{self._port}"

    def open(self) -> None:
        """Connect; an open connection is closed first.

        Raises:
            DeviceUnavailableError: If no peer listens or answers in time.
        """
        self.close()
        try:
            link = socket.create_connection((self._host, self._port), self._connect_s)
        except OSError as error:
            what = f"no connection to {self.where}: {error}; check the address and the cable"
            raise DeviceUnavailableError(what) from error
        self._socket = link
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # no delay for small requests
        # The kernel then reports ETIMEDOUT, also if the peer lost its power without closing.
        unacknowledged_ms = round(self._unacknowledged_s * 1000)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, unacknowledged_ms)
        # Two poll objects, made once, so that a wait in the loop registers nothing.
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(link, select.POLLIN)
        self._writable.register(link, select.POLLOUT)

    def close(self) -> None:
        """Close the connection. Never raises."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.close()
            self._socket = None

    def send(self, data: bytes) -> None:
        """Send all bytes. Real-time safe.

        Raises:
            LineFault: `PARTIAL_WRITE` if only a part was sent in time, `DISCONNECTED` if the
                connection is lost, `HALF_OPEN` if nothing is acknowledged.
        """
        link = self._require_open()
        trace_sent(self.where, data)
        try:
            sent = link.send(data)
            if sent < len(data):
                self._send_rest(link, data, sent)
        except BlockingIOError:
            self._send_rest(link, data, 0)
        except OSError as error:
            raise self._line_fault(error) from error

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes, as soon as there are any. Real-time safe.

        Args:
            within_ns: How long to wait for the first byte, in ns; 0 for no wait.

        Returns:
            At least one byte, or nothing if none came in time.

        Raises:
            LineFault: `DISCONNECTED` if the connection is lost, `HALF_OPEN` if nothing is
                acknowledged.
        """
        link = self._require_open()
        if not self._readable.poll(within_ns / 1e6):
            return b""
        try:
            data = link.recv(_MOST_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._line_fault(error) from error
        if not data:  # end of file
            raise LineFault(DeviceFlag.DISCONNECTED, f"{self.where} has closed the connection")
        trace_received(self.where, data)
        return data

    def now_ns(self) -> int:
        """Return the time of the machine's monotonic clock, in ns. Real-time safe."""
        return time.monotonic_ns()

    def _send_rest(self, link: socket.socket, data: bytes, sent: int) -> None:
        end_ns = time.monotonic_ns() + _SEND_NS
        while (left_ns := end_ns - time.monotonic_ns()) > 0:
            if self._writable.poll(left_ns / 1e6):
                try:
                    sent += link.send(data[sent:])
                except BlockingIOError:
                    continue
                except OSError as error:
                    raise self._line_fault(error) from error
            if sent == len(data):
                return
        # The sent part cannot be taken back, and another request must not follow it.
        self.close()
        what = f"{self.where}: {sent} of {len(data)} bytes went out, the connection is given up"
        raise LineFault(DeviceFlag.PARTIAL_WRITE, what)

    def _require_open(self) -> socket.socket:
        if self._socket is None:
            raise LineFault(DeviceFlag.DISCONNECTED, f"{self.where} is not connected")
        return self._socket

    def _line_fault(self, error: OSError) -> LineFault:
        if error.errno == ETIMEDOUT:
            what = f"{self.where} acknowledges nothing for {self._unacknowledged_s:g} s"
            return LineFault(DeviceFlag.HALF_OPEN, what)
        return LineFault(DeviceFlag.DISCONNECTED, f"{self.where} is lost: {error}")
