"""A line with its own clock, whose other end is a function of the test."""

from collections.abc import Callable
from typing import Final, TypeAlias

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError

MS: Final = 1_000_000

Answer: TypeAlias = Callable[[bytes], list[tuple[int, bytes]]]
"""Returns the replies to a request: the delay in ns, and the bytes, of each."""


class PlayedLine:
    """Implements `Line` and `NoticingLine`.

    Args:
        answer: The other end.
    """

    def __init__(self, answer: Answer = lambda _request: []) -> None:
        self.answer = answer
        self.t_ns = 1_000_000_000
        self.sent: list[bytes] = []
        self.fault: DeviceFlag | None = None
        """Raised by every call while it is not None."""
        self.absent = False
        self.noticed: set[DeviceFlag] = set()
        self.opened = 0
        self._coming: list[tuple[int, bytes]] = []

    @property
    def where(self) -> str:
        return "here"

    def open(self) -> None:
        if self.absent:
            raise DeviceUnavailableError("nobody is here")
        self.opened += 1

    def close(self) -> None:
        self.opened = 0

    def now_ns(self) -> int:
        return self.t_ns

    def send(self, data: bytes) -> None:
        self._check()
        self.sent.append(data)
        for after_ns, reply in self.answer(data):
            self.comes(reply, after_ns)

    def comes(self, data: bytes, after_ns: int = 0) -> None:
        """Let bytes arrive."""
        self._coming.append((self.t_ns + after_ns, data))
        self._coming.sort(key=lambda coming: coming[0])

    def receive(self, within_ns: int) -> bytes:
        self._check()
        end_ns = self.t_ns + within_ns
        if not self._coming or self._coming[0][0] > end_ns:
            self.t_ns = end_ns
            return b""
        self.t_ns = max(self.t_ns, self._coming[0][0])
        got = b""
        while self._coming and self._coming[0][0] <= self.t_ns:
            got += self._coming.pop(0)[1]
        return got

    def take_noticed(self) -> set[DeviceFlag]:
        noticed, self.noticed = self.noticed, set()
        return noticed

    def _check(self) -> None:
        if self.fault is not None:
            raise LineFault(self.fault, "it is broken")
