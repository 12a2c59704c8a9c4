"""A CAN bus by python-can: socketcan, udp_multicast, virtual, and whatever else it supports."""

from __future__ import annotations

import errno
import time
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
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
"""Interfaces that give a sender its own frames too, and do not say so."""
_MOST_ECHOES: Final = 256

_FULL: Final = frozenset({errno.ENOBUFS, errno.EAGAIN})
_FULL_TEXT: Final = "transmit buffer full"
"""What python-can's socketcan says, with no errno, where the socket never became writable."""
_NO_FRAME: Final = "could not unpack"
"""What python-can's udp_multicast says of a packet that is none of its own."""

# Error frames of socketcan: classes in the identifier, the controller's state in the second byte.
_CLASS_CONTROLLER: Final = 0x004
_CLASS_BUS_OFF: Final = 0x040
_SENDER_PASSIVE: Final = 0x20


class LibraryBus:
    """Implements `FrameBus` over a bus of python-can, without its threads.

    Where the interface is socketcan and its queue may hold frames that could not leave, because the
    bus was left or stalled, opening takes the interface down and up again, which needs the right to
    do so; without it, opening is refused until somebody has.

    Args:
        interface: python-can's name of it.
        channel: What the interface calls the bus.
        settings: More arguments of the interface.
        network: Takes an interface of the kernel down and up; tests have their own.
    """

    def __init__(
        self,
        interface: str,
        channel: str,
        settings: Mapping[str, Any],
        network: interface_control.Network | None = None,
    ) -> None:
        self._interface, self._channel, self._settings = interface, channel, dict(settings)
        self._network = network or interface_control.Kernel()
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
        """Connect, with nothing of an earlier connection in any queue.

        Args:
            accepted: Identifiers that are read; socketcan passes no others on.

        Raises:
            DeviceUnavailableError: If it is absent, or its queue may hold old frames and cannot be
                emptied.
        """
        import can  # noqa: PLC0415 - only who opens a bus needs the library

        self.close()
        self._purge()
        # Elsewhere python-can would filter by itself, and take a frame that is dropped for the
        # last.
        filters = _filters(accepted) if self._interface == SOCKETCAN else None
        try:
            self._bus = can.Bus(
                channel=self._channel,
                interface=self._interface,
                ignore_config=True,
                can_filters=filters,
                **self._settings,
            )
        except (can.CanError, OSError, ValueError, TypeError, NotImplementedError) as error:
            what = f"{self.where} cannot be opened: {error}"
            raise DeviceUnavailableError(what + _remedy(self._interface, error)) from error
        self._echoes = deque(maxlen=_MOST_ECHOES) if self._interface in _ECHOING else None
        self._noticed.clear()

    def close(self) -> None:
        """Let go of it; python-can drops what it has not handed to the kernel. Never raises."""
        bus, self._bus = self._bus, None
        if bus is None:
            return
        with suppress(Exception):  # each interface of python-can raises what it likes
            bus.flush_tx_buffer()
        with suppress(Exception):
            bus.shutdown()

    def send(self, frame: Frame) -> None:
        """Hand a frame to the interface, without waiting; may be called in the loop.

        Raises:
            LineFault: `NOT_SENT` if its queue is full, `DISCONNECTED` if it is gone.
        """
        bus, message = self._require(), self._message(frame)
        try:
            bus.send(message, 0)
        except OSError as error:  # can.CanError is none
            raise self._send_fault(error, error.errno) from error
        except Exception as error:
            # Interfaces raise can.CanError, and some whatever their maker's library raises.
            raise self._send_fault(error, getattr(error, "error_code", None)) from error
        if self._echoes is not None:
            self._echoes.append((frame.id, frame.data))

    def receive(self, within_ns: int) -> Frame | None:
        """Return the next frame that is not our own; may be called in the loop.

        Raises:
            LineFault: `BUS_OFF` if the controller says that it has left the bus, `DISCONNECTED` if
                it is gone.
        """
        bus = self._require()
        end_ns = time.monotonic_ns() + within_ns if within_ns else 0
        while True:
            left_ns = end_ns - time.monotonic_ns() if within_ns else 0
            try:
                message = bus.recv(left_ns * 1e-9 if left_ns > 0 else 0)
            except Exception as error:  # as for `send`
                if _NO_FRAME not in str(error):
                    what = f"{self.where} is lost: {error}"
                    raise LineFault(DeviceFlag.DISCONNECTED, what) from error
                self._noticed.add(DeviceFlag.GARBAGE)
                continue
            if message is None:
                return None
            if message.is_error_frame:
                self._take_error(message.arbitration_id, bytes(message.data))
            elif not message.is_fd:
                frame = Frame(
                    message.arbitration_id,
                    bytes(message.data),
                    message.is_extended_id,
                    message.is_remote_frame,
                )
                if not self._is_echo(frame):
                    return frame

    def now_ns(self) -> int:
        """Tell the instant on the machine's monotonic clock; may be called in the loop."""
        return time.monotonic_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making a call fail, since the last call."""
        noticed, self._noticed = self._noticed, set()
        return noticed

    def stalled(self) -> None:
        """Be told that frames do not leave: they must not be there when it is opened again."""
        if self._interface == SOCKETCAN:
            self._downs_when_stalled = self._network.times_down(self._channel)

    def _purge(self) -> None:
        if self._downs_when_stalled is None:
            return
        if self._network.times_down(self._channel) == self._downs_when_stalled:
            self._network.restart(self._channel)
        self._downs_when_stalled = None

    def _message(self, frame: Frame) -> can.Message:
        key = frame.id, frame.extended
        message = self._messages.get(key)
        if message is None:
            import can  # noqa: PLC0415 - loaded by `open`

            message = self._messages[key] = can.Message(
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

    def _take_error(self, classes: int, data: bytes) -> None:
        if classes & _CLASS_BUS_OFF:
            self.stalled()
            raise LineFault(DeviceFlag.BUS_OFF, f"{self.where}: the controller has left the bus")
        if classes & _CLASS_CONTROLLER and len(data) > 1 and data[1] & _SENDER_PASSIVE:
            self._noticed.add(DeviceFlag.NOT_SENT)

    def _is_echo(self, frame: Frame) -> bool:
        echoes = self._echoes
        if echoes and (key := (frame.id, frame.data)) in echoes:
            echoes.remove(key)
            return True
        return False

    def _require(self) -> can.BusABC:
        if self._bus is None:
            raise LineFault(DeviceFlag.DISCONNECTED, f"{self.where} is not open")
        return self._bus


def _filters(accepted: Iterable[int]) -> list[CanFilter]:
    return [{"can_id": i, "can_mask": 0x1FFF_FFFF if i > 0x7FF else 0x7FF} for i in accepted]


def _remedy(interface: str, error: Exception) -> str:
    if "msgpack" in str(error):
        return '; install it: pip install "piezod[can]"'
    if interface == SOCKETCAN and getattr(error, "errno", None) == errno.ENODEV:
        return "; bring it up: ip link set can0 up type can bitrate 500000"
    if interface == SOCKETCAN and getattr(error, "errno", None) == errno.EAFNOSUPPORT:
        return "; this kernel has no CAN"
    return ""
