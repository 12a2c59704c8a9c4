"""A serial port as a `Line`."""

from __future__ import annotations

import errno
import os
import select
import termios
import time
from contextlib import suppress
from fcntl import ioctl
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import Quantity
from piezod.devices.bus.byte_trace import trace_received, trace_sent
from piezod.devices.bus.line import LineFault
from piezod.devices.bus.port_holder import holder_of
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError, PortHeldError
from piezod.units import NS_PER_S

if TYPE_CHECKING:
    from serial import Serial

Parity: TypeAlias = Literal["N", "E", "O"]
SettleMs: TypeAlias = Annotated[
    float,
    Quantity(0, 30_000, "ms"),
    Field(
        description="Time after each opening of the port in which nothing is sent, and what comes "
        "is dropped, ms: for a board that boots when its port is opened."
    ),
]
"""Option of every driver with a serial port; 0 by default, because most devices answer at once, and
each start, reconnection and `piezod safe` waits that long."""

_MOST_BYTES: Final = 65_536
_SEND_NS: Final = 50_000_000
"""Longest time to put a request into the kernel's buffer of 4096 bytes. Only a device with flow
control can let this buffer fill."""
_PTY_MAJORS: Final = range(136, 144)
"""Major device numbers of ptys on Linux."""


class SerialLine:
    """Implements `Line` and `NoticingLine` over a serial port, with exclusive access.

    Other programs cannot open the port while it is open: a lock refuses those that lock ports, the
    kernel refuses the others. The kernel delivers bytes without delay if the port supports it
    (low-latency mode). Bytes that are still unsent when a reply is overdue are dropped: an old
    setpoint must not leave later.

    The kernel raises DTR and RTS when a port is opened, which resets some boards. It cannot be kept
    from it, but it keeps them raised when the port is closed: only the first opening after the
    adapter was plugged in has the edge that resets.

    Args:
        port: Path of the port, preferably from /dev/serial/by-id.
        baud: Bits per second; 8 data bits.
        rtscts: Whether the device uses RTS/CTS flow control.
        xonxoff: Whether the device uses XON/XOFF flow control.
        parity: None, even or odd.
        stop_bits: 1 or 2.
        settle_s: Time after each opening in which nothing is sent, and what comes is dropped, in s:
            for a device that boots when its port is opened.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        *,
        rtscts: bool = False,
        xonxoff: bool = False,
        parity: Parity = "N",
        stop_bits: Literal[1, 2] = 1,
        settle_s: float = 0.0,
    ) -> None:
        self._port, self._baud, self._rtscts, self._xonxoff = port, baud, rtscts, xonxoff
        self._parity, self._stop_bits = parity, stop_bits
        self._settle_ns = round(settle_s * NS_PER_S)
        # Imported now and not by `open`: a line is opened again long after the start.
        from serial import Serial  # noqa: PLC0415 - who only checks a file needs no library

        self._library = Serial
        self._serial: Serial | None = None
        self._fd = -1
        self._readable = self._writable = select.poll()
        self._path = ""
        self._noticed: set[DeviceFlag] = set()

    @property
    def where(self) -> str:
        """Path of the port."""
        return self._port

    def open(self) -> None:
        """Open the port with empty buffers and wait until the device has settled.

        An open port is closed first.

        Raises:
            PortHeldError: If another program holds it.
            DeviceUnavailableError: If it is absent, no serial port, or lost meanwhile.
        """
        self.close()
        try:
            self._serial = self._library(
                self._port,
                self._baud,
                parity=self._parity,
                stopbits=self._stop_bits,
                rtscts=self._rtscts,
                xonxoff=self._xonxoff,
                exclusive=True,
                inter_byte_timeout=0,  # sets VMIN to 1: reading 0 bytes then means a lost port
            )
            self._fd = self._serial.fileno()
            self._refuse_others()
            self._keep_raised()
            path = str(Path(self._port).resolve())
        except (OSError, termios.error, ValueError, OverflowError) as error:
            self.close()
            raise _refusal(self._port, error) from error
        with suppress(ValueError):  # a pty and some adapters lack this mode
            self._serial.set_low_latency_mode(True)
        # Two poll objects, made once, so that a wait in the loop registers nothing.
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(self._fd, select.POLLIN)
        self._writable.register(self._fd, select.POLLOUT)
        if self._path not in {"", path}:
            self._noticed.add(DeviceFlag.OTHER_PATH)
        self._path = path
        self._settle()

    def close(self) -> None:
        """Close the port; unsent bytes are dropped. Never raises."""
        if self._serial is not None:
            with suppress(OSError, termios.error):
                # Otherwise close waits until all bytes are sent.
                termios.tcflush(self._fd, termios.TCOFLUSH)
            with suppress(OSError, termios.error):
                self._serial.close()
            self._serial, self._fd = None, -1
            self._readable, self._writable = select.poll(), select.poll()

    def send(self, data: bytes) -> None:
        """Send all bytes. Real-time safe.

        Raises:
            LineFault: `PARTIAL_WRITE` if only a part was sent in time, `DISCONNECTED` if the port
                is lost or not open.
        """
        trace_sent(self._port, data)
        # System calls instead of `Serial.write` and `Serial.read`, which wait in their own way.
        try:
            sent = os.write(self._fd, data)
            if sent < len(data):
                self._send_rest(data, sent)
        except BlockingIOError:
            self._send_rest(data, 0)
        except (OSError, termios.error) as error:
            raise self._disconnected(error) from error

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes, as soon as there are any. Real-time safe.

        Args:
            within_ns: How long to wait for the first byte, in ns; 0 for no wait.

        Returns:
            At least one byte, or nothing if none came in time.

        Raises:
            LineFault: `DISCONNECTED` if the port is lost or not open.
        """
        if self._fd < 0:
            raise self._disconnected("it is not open")
        try:
            if not self._readable.poll(within_ns / 1e6):
                if within_ns:  # the reply is overdue: an unsent rest of the request is stale
                    termios.tcflush(self._fd, termios.TCOFLUSH)
                return b""
            data = os.read(self._fd, _MOST_BYTES)
        except BlockingIOError:  # poll reported bytes, but none are left
            return b""
        except (OSError, termios.error) as error:
            raise self._disconnected(error) from error
        if not data:
            raise self._disconnected("it was unplugged")
        trace_received(self._port, data)
        return data

    def now_ns(self) -> int:
        """Return the time of the machine's monotonic clock, in ns. Real-time safe."""
        return time.monotonic_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return `OTHER_PATH` once after the port was opened again under another device path."""
        noticed, self._noticed = self._noticed, set()
        return noticed

    def _refuse_others(self) -> None:
        """Make the kernel refuse other programs; a pty would keep that after our exit."""
        if os.major(os.fstat(self._fd).st_rdev) not in _PTY_MAJORS:
            ioctl(self._fd, termios.TIOCEXCL)

    def _settle(self) -> None:
        """Drop what a device sends while it boots."""
        settled_ns = self.now_ns() + self._settle_ns
        try:
            while (left_ns := settled_ns - self.now_ns()) > 0:
                self.receive(left_ns)
        except LineFault as fault:
            self.close()
            raise DeviceUnavailableError(str(fault)) from fault

    def _keep_raised(self) -> None:
        """Make the kernel keep DTR and RTS raised when the port is closed."""
        settings = termios.tcgetattr(self._fd)
        settings[2] &= ~termios.HUPCL
        termios.tcsetattr(self._fd, termios.TCSANOW, settings)

    def _send_rest(self, data: bytes, sent: int) -> None:
        end_ns = time.monotonic_ns() + _SEND_NS
        while (left_ns := end_ns - time.monotonic_ns()) > 0:
            if self._writable.poll(left_ns / 1e6):
                with suppress(BlockingIOError):
                    sent += os.write(self._fd, data[sent:])
            if sent == len(data):
                return
        termios.tcflush(self._fd, termios.TCOFLUSH)  # an old setpoint must not leave later
        what = f"{self._port}: {sent} of {len(data)} bytes went out"
        raise LineFault(DeviceFlag.PARTIAL_WRITE, what)

    def _disconnected(self, why: object) -> LineFault:
        return LineFault(DeviceFlag.DISCONNECTED, f"{self._port} is lost: {why}")


def _refusal(port: str, error: Exception) -> DeviceUnavailableError:
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        what = f"no port {port}: plug it in, or name another one of /dev/serial/by-id; if it "
        what += "vanishes again, brltty may have taken it (docs: serial devices, brltty)"
        return DeviceUnavailableError(what)
    if number == errno.EACCES:
        what = f"no access to {port}: the user has to be in the group that it belongs to"
        return DeviceUnavailableError(what)
    locked = isinstance(error.__cause__ or error.__context__, BlockingIOError)
    if number == errno.EBUSY or locked or "lock" in str(error):  # EBUSY: refused by the kernel
        holder = holder_of(port)
        who = f" ({holder})" if holder else ""
        return PortHeldError(
            f"{port} is held by another program{who}: end it, or name another port"
        )
    return DeviceUnavailableError(f"{port} cannot be opened: {error}")
