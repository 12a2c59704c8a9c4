"""A CAN bus by python-can: socketcan, udp_multicast, virtual and its other interfaces."""

from __future__ import annotations

import errno
import time
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus import interface_control
from piezod_drivers.can_bus.frame import Frame

if TYPE_CHECKING:
    import can
    from can.typechecking import CanFilter

SOCKETCAN: Final = "socketcan"
_ECHOING: Final = frozenset({"udp_multicast"})
"""Interfaces that also deliver the sender's own frames, and do not mark them."""
# Echoes that never come must not fill the memory.
_MOST_SKIPPED: Final = 100
"""Error frames and echoes that one call of `receive` reads at most."""
_MOST_ECHOES: Final = 256

_FULL: Final = frozenset({errno.ENOBUFS, errno.EAGAIN})
_FULL_TEXT: Final = "transmit buffer full"
"""Text of python-can's socketcan if the socket did not become writable; it has no errno."""
_NO_FRAME: Final = "could not unpack"
"""Text of python-can's udp_multicast for a packet of another program."""

# Error frames of socketcan (linux/can/error.h): the classes are bits of the identifier, the second
# byte has the state of the controller.
_CLASS_CONTROLLER: Final = 0x004
_CLASS_BUS_OFF: Final = 0x040
_SENDER_PASSIVE: Final = 0x20


class LibraryBus:
    """Implements `FrameBus` by a bus of python-can, without its threads.

    With socketcan the kernel's queue may hold frames that were not sent, because the controller
    left the bus or the bus stalled. `open` then takes the interface down and up, which needs
    CAP_NET_ADMIN. Without this right `open` fails until the interface has been taken down and up.

    Args:
        interface: Name of the interface in python-can.
        channel: Name of the bus at the interface.
        settings: Further arguments of the interface.
        network: Takes an interface of the kernel down and up; tests replace it.
    """

    def __init__(
        self,
        interface: str,
        channel: str,
        settings: Mapping[str, Any],
        network: interface_control.InterfaceControl | None = None,
    ) -> None:
        # Imported now and not by `open`: a bus is opened again long after the start.
        self._can = _library(interface)
        self._interface, self._channel, self._settings = interface, channel, dict(settings)
        self._network = network or interface_control.KernelInterfaces()
        self._bus: can.BusABC | None = None
        self._messages: dict[tuple[int, bool], can.Message] = {}
        self._echoes: deque[tuple[int, bytes]] | None = None
        self._noticed: set[DeviceFlag] = set()
        self._downs_when_stalled: int | None = None

    @property
    def where(self) -> str:
        """Interface and channel."""
        return f"{self._interface} {self._channel}"

    def open(self, accepted: Iterable[int]) -> None:
        """Connect, with empty queues.

        Args:
            accepted: Identifiers to be read; socketcan does not pass on others.

        Raises:
            DeviceUnavailableError: If the bus is absent, or its queue may hold old frames and
                cannot be emptied.
        """
        self.close()
        self._empty_queue()
        # For other interfaces python-can filters in Python, and its `recv` returns None for a frame
        # that the filter drops: pending frames behind it would be missed.
        filters = _filters(accepted) if self._interface == SOCKETCAN else None
        try:
            self._bus = self._can.Bus(
                channel=self._channel,
                interface=self._interface,
                # Settings in a configuration file of python-can must not change the bus.
                ignore_config=True,
                can_filters=filters,
                **self._settings,
            )
        except (self._can.CanError, OSError, ValueError, TypeError, NotImplementedError) as error:
            what = f"{self.where} cannot be opened: {error}"
            raise DeviceUnavailableError(what + _hint(self._interface, error)) from error
        self._echoes = deque(maxlen=_MOST_ECHOES) if self._interface in _ECHOING else None
        self._noticed.clear()

    def close(self) -> None:
        """Disconnect; python-can drops frames that the kernel does not have yet. Never raises."""
        bus, self._bus = self._bus, None
        if bus is None:
            return
        # Discard frames that python-can still queues: an old setpoint must not be sent later.
        with suppress(Exception):  # each interface of python-can raises errors of its own
            bus.flush_tx_buffer()
        with suppress(Exception):
            bus.shutdown()

    def send(self, frame: Frame) -> None:
        """Hand a frame to the interface, without waiting. Real-time safe.

        Raises:
            LineFault: `NOT_SENT` if the queue is full, `DISCONNECTED` if the connection is lost.
        """
        bus, message = self._require_open(), self._message(frame)
        try:
            bus.send(message, 0)
        except OSError as error:  # can.CanError is no OSError
            raise self._send_fault(error, error.errno) from error
        except Exception as error:
            # Interfaces raise can.CanError; some raise errors of their maker's library.
            raise self._send_fault(error, getattr(error, "error_code", None)) from error
        if self._echoes is not None:
            self._echoes.append((frame.id, frame.data))

    def receive(self, within_ns: int) -> Frame | None:
        """Return the next frame that this end has not sent. Real-time safe.

        Raises:
            LineFault: `BUS_OFF` if the controller reports that it has left the bus, `DISCONNECTED`
                if the connection is lost.
        """
        bus = self._require_open()
        end_ns = time.monotonic_ns() + within_ns if within_ns else 0
        # Echoes and error frames do not count as frames; the wait goes on with the time that is
        # left. A controller that nobody acknowledges may report errors faster than they are read.
        for _ in range(_MOST_SKIPPED):
            left_ns = end_ns - time.monotonic_ns() if within_ns else 0
            try:
                message = bus.recv(left_ns * 1e-9 if left_ns > 0 else 0)
            except Exception as error:  # as in `send`
                if _NO_FRAME not in str(error):
                    what = f"{self.where} is lost: {error}"
                    raise LineFault(DeviceFlag.DISCONNECTED, what) from error
                self._noticed.add(DeviceFlag.GARBAGE)
                continue
            if message is None:
                return None
            if message.is_error_frame:
                self._handle_error_frame(message.arbitration_id, bytes(message.data))
            # A CAN FD frame cannot come from a device of this driver.
            elif not message.is_fd:
                frame = Frame(
                    message.arbitration_id,
                    bytes(message.data),
                    message.is_extended_id,
                    message.is_remote_frame,
                )
                if not self._is_echo(frame):
                    return frame
        return None

    def now_ns(self) -> int:
        """Return the instant on the machine's monotonic clock. Real-time safe."""
        return time.monotonic_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags of faults that no call has raised. Real-time safe."""
        noticed, self._noticed = self._noticed, set()
        return noticed

    def mark_stalled(self) -> None:
        """Note that frames do not leave the queue; the next `open` discards them."""
        if self._interface == SOCKETCAN:
            self._downs_when_stalled = self._network.down_count(self._channel)

    def _empty_queue(self) -> None:
        if self._downs_when_stalled is None:
            return
        # If the interface has been taken down since it stalled, its queue is already empty.
        if self._network.down_count(self._channel) == self._downs_when_stalled:
            self._network.restart(self._channel)
        self._downs_when_stalled = None

    def _message(self, frame: Frame) -> can.Message:
        key = frame.id, frame.extended
        message = self._messages.get(key)
        if message is None:
            # One message object for each identifier, used again in each cycle: constructing it is
            # slow.
            message = self._messages[key] = self._can.Message(
                arbitration_id=frame.id,
                is_extended_id=frame.extended,
                is_remote_frame=frame.remote,
                dlc=len(frame.data),
            )
        message.is_remote_frame = frame.remote
        message.dlc = len(frame.data)
        message.data = bytearray() if frame.remote else bytearray(frame.data)
        return message

    def _send_fault(self, error: Exception, number: int | None) -> LineFault:
        if number in _FULL or _FULL_TEXT in str(error).lower():
            return LineFault(DeviceFlag.NOT_SENT, f"{self.where}: the transmit queue is full")
        return LineFault(DeviceFlag.DISCONNECTED, f"{self.where} is lost: {error}")

    def _handle_error_frame(self, classes: int, data: bytes) -> None:
        if classes & _CLASS_BUS_OFF:
            self.mark_stalled()
            raise LineFault(DeviceFlag.BUS_OFF, f"{self.where}: the controller has left the bus")
        # Passive as a sender: in most cases no other node acknowledges its frames.
        if classes & _CLASS_CONTROLLER and len(data) > 1 and data[1] & _SENDER_PASSIVE:
            self._noticed.add(DeviceFlag.NOT_SENT)

    def _is_echo(self, frame: Frame) -> bool:
        echoes = self._echoes
        if echoes and (key := (frame.id, frame.data)) in echoes:
            # Only one echo belongs to each sent frame: an equal frame after it is a foreign one.
            echoes.remove(key)
            return True
        return False

    def _require_open(self) -> can.BusABC:
        if self._bus is None:
            raise LineFault(DeviceFlag.DISCONNECTED, f"{self.where} is not open")
        return self._bus


def _filters(accepted: Iterable[int]) -> list[CanFilter]:
    # The mask compares all bits of the identifier: 11, or 29 of an extended frame.
    return [{"can_id": i, "can_mask": 0x1FFF_FFFF if i > 0x7FF else 0x7FF} for i in accepted]


def _hint(interface: str, error: Exception) -> str:
    if "msgpack" in str(error):
        return '; install msgpack: pip install "piezod[can]"'
    if interface == SOCKETCAN and getattr(error, "errno", None) == errno.ENODEV:
        return "; bring it up: ip link set can0 up type can bitrate 500000"
    if interface == SOCKETCAN and getattr(error, "errno", None) == errno.EAFNOSUPPORT:
        return "; this kernel has no CAN"
    return ""


def _library(interface: str) -> ModuleType:
    """Import python-can with the module of an interface, and return it."""
    import can  # noqa: PLC0415 - who only checks a file needs no library

    module, _ = can.interfaces.BACKENDS.get(interface, ("can.interface", ""))
    with suppress(Exception):  # a library by the maker of the adapter is missing: `open` says that
        import_module(module)
    return can
