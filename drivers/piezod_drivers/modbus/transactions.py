"""One request and its reply at a time, independent of the frames around them."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Protocol

from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.line import Line
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.codec import ModbusRequest


class Transactions(Protocol):
    """Carries requests to one device, or to several on one line."""

    def open(self) -> None:
        """Connect.

        Raises:
            DeviceUnavailableError: If that fails.
        """
        ...

    def close(self) -> None:
        """Disconnect. Never raises."""
        ...

    def ask(self, unit: int, requests: Sequence[ModbusRequest], first: int = 0) -> bytes:
        """Send one of several equivalent requests and return its reply. Real-time safe.

        Args:
            unit: Address of the device on the line.
            requests: Requests for the same data whose replies differ in form.
            first: Index of the preferred request. Another one is sent while a late reply to it may
                come.

        Returns:
            The reply, with its function code.

        Raises:
            LineFault: If there is no reply in time, or the device refuses.
        """
        ...

    def opening(self) -> AbstractContextManager[None]:
        """Repeat the first request of a block as long as the device may boot."""
        ...

    def is_free(self, unit: int, requests: Sequence[ModbusRequest]) -> bool:
        """Return whether no late reply can be mistaken for one to these. Real-time safe."""
        ...

    def settle(self) -> None:
        """Wait until no late reply can disturb the next request. Not real-time safe.

        Raises:
            LineFault: If the line is lost.
        """
        ...

    def now_ns(self) -> int:
        """Return the instant on the line's clock. Real-time safe."""
        ...

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags of faults that no call has raised. Real-time safe."""
        ...


class LineTransactions:
    """The common part of TCP and RTU.

    Args:
        timeout_s: Longest wait for a reply, in s.
    """

    def __init__(self, line: Line, timeout_s: float) -> None:
        self._line, self._timeout_ns = line, round(timeout_s * 1e9)
        self._conversation = Conversation(line, timeout_s)
        self._noticed: set[DeviceFlag] = set()

    def open(self) -> None:
        """Connect, and forget all earlier exchanges.

        Raises:
            DeviceUnavailableError: If that fails.
        """
        self._line.open()
        self._conversation.restart()

    def close(self) -> None:
        """Disconnect. Never raises."""
        self._line.close()

    def opening(self) -> AbstractContextManager[None]:
        """Repeat the first request of a block as long as the device may boot."""
        return self._conversation.opening()

    def now_ns(self) -> int:
        """Return the instant on the line's clock. Real-time safe."""
        return self._line.now_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags of faults that no call has raised. Real-time safe."""
        noticed = self._conversation.take_noticed() | self._noticed
        self._noticed = set()
        return noticed

    def name_of(self, unit: int) -> str:
        """Return the name of a unit for messages to people."""
        return f"unit {unit} at {self._line.where}"
