"""Separates unrequested messages from replies, so that none is taken for a reply."""

from typing import Final

from piezod.devices.bus.line import Line, LineWrapper
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.thorlabs_apt.codec import (
    MAX_MESSAGE_BYTES,
    Id,
    ident_of,
    length_to_host,
)

_STALE_NS: Final = 50_000_000
"""An incomplete message is dropped after this time; the longest one takes 8 ms."""
_ERROR_MESSAGES: Final = frozenset({Id.RESPONSE, Id.RICH_RESPONSE})
_SET_ASIDE: Final = frozenset({Id.GET_STATUS, Id.GET_GAUGE_IO})
_REPLIES: Final = frozenset(map(int, Id)) - _ERROR_MESSAGES


class FilteredLine(LineWrapper):
    """A line that passes on only messages that are wanted.

    Statuses and settings that are not wanted are set aside. Error messages and garbage
    are noticed. All other messages are dropped.
    """

    def __init__(self, line: Line) -> None:
        super().__init__(line)
        self._incomplete = b""
        self._incomplete_since_ns = 0
        self._noticed: set[DeviceFlag] = set()
        self.wanted = 0
        """Identifier of the messages that are passed on."""
        self.aside: dict[int, bytes] = {}
        """The last message of each kind that is set aside, by its identifier."""

    def open(self) -> None:
        """Connect, as the line does."""
        super().open()
        self._incomplete = b""
        self.aside.clear()
        self._noticed.clear()

    def receive(self, within_ns: int) -> bytes:
        """Return complete wanted messages that have come. Real-time safe.

        Returns:
            Nothing also if only other messages have come.
        """
        before, data = self._incomplete, self._line.receive(within_ns)
        if not before:  # nearly always nothing has come, or exactly the wanted message
            if not data:
                return data
            if length_to_host(data) == len(data) and ident_of(data) == self.wanted:
                return data
        got, place = before + data, 0
        # An incomplete message that no longer grows must not swallow the next one.
        stale = got == before and self._line.now_ns() - self._incomplete_since_ns > _STALE_NS
        wanted_messages: list[bytes] = []
        while place < len(got):
            window = got[place : place + MAX_MESSAGE_BYTES]
            length = length_to_host(window)
            if length == 0 and not stale:
                break
            if length > 0:
                self._sort(window[:length], wanted_messages)
            else:
                self._noticed.add(DeviceFlag.GARBAGE)
            # After garbage the search goes on at the next byte.
            place += max(length, 1)
        self._incomplete = got[place:]
        if got != before:
            self._incomplete_since_ns = self._line.now_ns()
        return b"".join(wanted_messages)

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the noticed flags. Real-time safe."""
        noticed, self._noticed = self._noticed, set()
        return noticed | super().take_noticed()

    def forget_noticed(self) -> None:
        """Clear the flags noticed by this filter."""
        self._noticed.clear()

    def _sort(self, frame: bytes, wanted_messages: list[bytes]) -> None:
        if ident_of(frame) == self.wanted:
            wanted_messages.append(frame)
        else:
            self._handle_unrequested(frame)

    def _handle_unrequested(self, frame: bytes) -> None:
        ident = ident_of(frame)
        if ident in _SET_ASIDE:
            self.aside[ident] = frame
        elif ident in _ERROR_MESSAGES:
            self._noticed.add(DeviceFlag.DEVICE_FAILURE)
        # Messages with an unknown identifier are dropped without a flag.
        elif ident in _REPLIES:
            self._noticed.add(DeviceFlag.OUT_OF_ORDER)
