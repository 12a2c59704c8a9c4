"""Lines of a test, in virtual time: one plays a script, one leads to an emulator."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.emulation.emulator import Emulator
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError

T0_NS: Final = 1_000_000_000
US: Final = 1_000
MS: Final = 1_000_000


class TestTime:
    """A clock that only advances while a line waits."""

    __test__ = False  # not a test, in spite of its name

    def __init__(self) -> None:
        self.t_ns = T0_NS

    def now_ns(self) -> int:
        """Return the instant."""
        return self.t_ns


MANY: Final = 20
"""More often than a first request is repeated."""


@dataclass(frozen=True)
class Step:
    """An expected request of a script, and its replies."""

    sent: bytes  #: All bytes that the driver sends in this step.
    #: Parts of the reply, each with a delay to the one before it, in ns.
    replies: tuple[tuple[int, bytes], ...] = ()


def exchange(sent: bytes, *replies: bytes, after_ns: int = 100 * US) -> Step:
    """Return a step in which each part of the reply comes after the same delay."""
    return Step(sent, tuple((after_ns, reply) for reply in replies))


class _PlayedLine:
    """The common part of the lines: bytes that arrive when they are due.

    Args:
        time: Clock of the line.
    """

    def __init__(self, time: TestTime) -> None:
        self.time = time
        self.opened = False
        self.unplugged = False
        self.absent = False
        self._coming: deque[tuple[int, bytes]] = deque()

    @property
    def where(self) -> str:
        return "a line of this test"

    def open(self) -> None:
        if self.absent:
            raise DeviceUnavailableError(f"{self.where}: no device")
        self.opened = True

    def close(self) -> None:
        self.opened = False

    def now_ns(self) -> int:
        return self.time.t_ns

    def comes(self, data: bytes, after_ns: int = 0) -> None:
        """Let bytes arrive unrequested, this time after the last pending ones, or after now."""
        now_ns = self.time.t_ns
        last_ns = max(self._coming[-1][0], now_ns) if self._coming else now_ns
        self._coming.append((last_ns + after_ns, data))

    def receive(self, within_ns: int) -> bytes:
        self._require()
        until_ns = self.time.t_ns + within_ns
        if not self._coming or self._coming[0][0] > until_ns:
            self.time.t_ns = until_ns
            return b""
        self.time.t_ns = max(self.time.t_ns, self._coming[0][0])
        got = b""
        while self._coming and self._coming[0][0] <= self.time.t_ns:
            got += self._coming.popleft()[1]
        return got

    def _require(self) -> None:
        if self.unplugged or not self.opened:
            raise LineFault(DeviceFlag.DISCONNECTED, f"{self.where} is gone")


class ScriptedLine(_PlayedLine):
    """Implements `Line`; fails at the first byte that differs from the script.

    Args:
        *steps: The expected requests, in order; `then` adds more.
    """

    def __init__(self, *steps: Step) -> None:
        super().__init__(TestTime())
        self._steps = deque(steps)

    def then(self, *steps: Step) -> None:
        """Add steps to the script."""
        self._steps.extend(steps)

    def send(self, data: bytes) -> None:
        self._require()
        assert self._steps, f"{data!r} was sent, and the script is at its end"
        step = self._steps.popleft()
        assert data == step.sent
        for delay_ns, reply in step.replies:
            self.comes(reply, delay_ns)

    def assert_done(self) -> None:
        """Fail if the driver has not sent everything in the script."""
        assert not self._steps, f"never sent: {[step.sent for step in self._steps]}"


class EmulatedLine(_PlayedLine):
    """Implements `Line` to an emulator in this process, with the clock of the emulator's rig.

    Args:
        emulator: The device.
        time: Clock of the device's rig.
        delay_ns: Delay of each reply, in ns.
    """

    def __init__(self, emulator: Emulator, time: TestTime, delay_ns: int = 100 * US) -> None:
        super().__init__(time)
        self._emulator, self._delay_ns = emulator, delay_ns
        self.sent: list[bytes] = []
        """All writes of the driver."""
        self.change: Callable[[bytes], bytes] = lambda reply: reply
        """Changes each reply on its way; b"" loses it."""

    def send(self, data: bytes) -> None:
        self._require()
        self.sent.append(data)
        for reply in self._emulator.receive(data):
            self.comes(self.change(reply), self._delay_ns)

    def receive(self, within_ns: int) -> bytes:
        for unasked in self._emulator.due():
            self.comes(unasked)
        return super().receive(within_ns)
