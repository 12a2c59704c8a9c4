"""One request and its reply at a time, whatever the frames around them."""

from collections.abc import Sequence
from typing import Protocol

from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.line import Line
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.codec import ModbusRequest


class Transactions(Protocol):
    """Carries requests to one device or to several on one line."""

    def open(self) -> None:
        """Connect.

        Raises:
            DeviceUnavailableError: If that fails.
        """
        ...

    def close(self) -> None:
        """Let go. Never raises."""
        ...

    def ask(self, unit: int, requests: Sequence[ModbusRequest], first: int = 0) -> bytes:
        """Send one request of several that ask for the same; may be called in the loop.

        Args:
            unit: Address of the device on the line.
            requests: The same question in forms whose replies can be told apart.
            first: Which one is to be taken, if a late reply to it cannot come any more.

        Returns:
            The reply with its function.

        Raises:
            LineFault: If there is no answer in time, or the device refuses.
        """
        ...

    def is_free(self, unit: int, requests: Sequence[ModbusRequest]) -> bool:
        """Tell whether no late reply can be mistaken for one to these; call it in the loop."""
        ...

    def settle(self) -> None:
        """Wait until no late reply can come that would be in the way; not to be called in the loop.

        Raises:
            LineFault: If the line is gone.
        """
        ...

    def now_ns(self) -> int:
        """Tell the instant on the line's clock; may be called in the loop."""
        ...

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail, and forget it."""
        ...


class OneLine:
    """What both kinds of transactions have in common.

    Args:
        line: The line.
        timeout_s: How long to wait for a reply, in s.
    """

    def __init__(self, line: Line, timeout_s: float) -> None:
        self._line, self._timeout_ns = line, round(timeout_s * 1e9)
        self._conversation = Conversation(line, timeout_s)
        self._noticed: set[DeviceFlag] = set()

    def open(self) -> None:
        """Connect, and forget what was before.

        Raises:
            DeviceUnavailableError: If that fails.
        """
        self._line.open()
        self._conversation.restart()

    def close(self) -> None:
        """Let go. Never raises."""
        self._line.close()

    def now_ns(self) -> int:
        """Tell the instant on the line's clock; may be called in the loop."""
        return self._line.now_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail, and forget it."""
        noticed = self._conversation.take_noticed() | self._noticed
        self._noticed = set()
        return noticed

    def who(self, unit: int) -> str:
        """Tell who is asked, for people."""
        return f"unit {unit} at {self._line.where}"
