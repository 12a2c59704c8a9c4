"""Keeps apart what a device says unasked: it can never be taken for a reply."""

from typing import Final

from piezod.devices.bus.line import Line, NoticingLine
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.thorlabs_apt.codec import (
    MOST_BYTES,
    CubeStatus,
    Id,
    ident_of,
    length_to_host,
    status_of,
)

_STALE_NS: Final = 50_000_000
"""A message whose rest has not come after that time is none; the longest takes 8 ms."""
_COMPLAINTS: Final = frozenset({Id.RESPONSE, Id.RICH_RESPONSE})
_REPLIES: Final = frozenset(map(int, Id)) - _COMPLAINTS


class FilteredLine:
    """Implements `Line` and `NoticingLine` with nothing on it but the messages that are wanted.

    Statuses that come beside what is wanted are kept, complaints and bytes that are no message are
    noticed, and everything else is dropped.

    Args:
        line: The line to the device.
    """

    def __init__(self, line: Line) -> None:
        self._line = line
        self._rest = b""
        self._rest_since_ns = 0
        self._noticed: set[DeviceFlag] = set()
        self.wanted = 0
        """What the messages are that are passed on."""
        self.status: CubeStatus | None = None
        """The last one that came, asked for or not."""

    @property
    def where(self) -> str:
        """Where it leads to."""
        return self._line.where

    def open(self) -> None:
        """Connect, as the line does."""
        self._line.open()
        self._rest, self.status = b"", None
        self._noticed.clear()

    def close(self) -> None:
        """Let go. Never raises."""
        self._line.close()

    def send(self, data: bytes) -> None:
        """Send all of this, as the line does; may be called in the loop."""
        self._line.send(data)

    def receive(self, within_ns: int) -> bytes:
        """Return what has come and is wanted, in whole messages; may be called in the loop.

        Returns:
            Nothing also where only the unwanted came.
        """
        before, data = self._rest, self._line.receive(within_ns)
        if not before:  # nearly always there is nothing, or just what is wanted
            if not data:
                return data
            if length_to_host(data) == len(data) and ident_of(data) == self.wanted:
                return data
        got, place = before + data, 0
        stale = got == before and self._line.now_ns() - self._rest_since_ns > _STALE_NS
        passed: list[bytes] = []
        while place < len(got):
            window = got[place : place + MOST_BYTES]
            length = length_to_host(window)
            if length == 0 and not stale:
                break
            if length > 0:
                self._sort(window[:length], passed)
            else:
                self._noticed.add(DeviceFlag.GARBAGE)
            place += max(length, 1)
        self._rest = got[place:]
        if got != before:
            self._rest_since_ns = self._line.now_ns()
        return b"".join(passed)

    def now_ns(self) -> int:
        """Tell the instant, as the line does."""
        return self._line.now_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what was noticed since the last call, and forget it; may be called in the loop."""
        noticed, self._noticed = self._noticed, set()
        return (
            noticed | self._line.take_noticed() if isinstance(self._line, NoticingLine) else noticed
        )

    def forget_noticed(self) -> None:
        """Forget what was noticed here."""
        self._noticed.clear()

    def _sort(self, frame: bytes, passed: list[bytes]) -> None:
        if ident_of(frame) == self.wanted:
            passed.append(frame)
        else:
            self._put_aside(frame)

    def _put_aside(self, frame: bytes) -> None:
        ident = ident_of(frame)
        if ident == Id.GET_STATUS:
            self.status = status_of(frame)
        elif ident in _COMPLAINTS:
            self._noticed.add(DeviceFlag.DEVICE_FAILURE)
        elif ident in _REPLIES:
            self._noticed.add(DeviceFlag.OUT_OF_ORDER)
