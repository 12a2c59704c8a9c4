"""Lines of a test, in a time of their own: one plays a script, one leads to an emulator."""

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
    """A clock that stands still until somebody waits."""

    __test__ = False  # it is no test, whatever its name says

    def __init__(self) -> None:
        self.t_ns = T0_NS

    def now_ns(self) -> int:
        """Tell the instant."""
        return self.t_ns


@dataclass(frozen=True)
class Step:
    """What a script expects, and what it answers.

    Attributes:
        sent: All that the driver sends in this step, byte for byte.
        replies: What comes back, each part with a delay to the one before it, in ns.
    """

    sent: bytes
    replies: tuple[tuple[int, bytes], ...] = ()


def says(sent: bytes, *replies: bytes, after_ns: int = 100 * US) -> Step:
    """Return a step in which each part of the answer comes after the same delay."""
    return Step(sent, tuple((after_ns, reply) for reply in replies))


class _PlayedLine:
    """What lines of a test have in common: parts that arrive when they are due.

    Args:
        time: The line's clock.
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
            raise DeviceUnavailableError(f"{self.where}: nobody is there")
        self.opened = True

    def close(self) -> None:
        self.opened = False

    def now_ns(self) -> int:
        return self.time.t_ns

    def comes(self, data: bytes, after_ns: int = 0) -> None:
        """Let bytes arrive unasked, so long after the last that are on their way, or after now."""
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
    """Implements `Line`; fails at the first byte that the script does not have.

    Args:
        *steps: What is expected, in order; more can be added with `then`.
    """

    def __init__(self, *steps: Step) -> None:
        super().__init__(TestTime())
        self._steps = deque(steps)

    def then(self, *steps: Step) -> None:
        """Add to the script."""
        self._steps.extend(steps)

    def send(self, data: bytes) -> None:
        self._require()
        assert self._steps, f"{data!r} was sent, and the script is at its end"
        step = self._steps.popleft()
        assert data == step.sent
        for delay_ns, reply in step.replies:
            self.comes(reply, delay_ns)

    def assert_done(self) -> None:
        """Fail if the driver has not sent all that the script expects."""
        assert not self._steps, f"never sent: {[step.sent for step in self._steps]}"


class EmulatedLine(_PlayedLine):
    """Implements `Line` to an emulator in this process, on the clock of the emulator's bench.

    Args:
        emulator: The device.
        time: The clock that the device's bench looks at.
        delay_ns: After what time each reply comes.
    """

    def __init__(self, emulator: Emulator, time: TestTime, delay_ns: int = 100 * US) -> None:
        super().__init__(time)
        self._emulator, self._delay_ns = emulator, delay_ns
        self.sent: list[bytes] = []
        """Everything that the driver has sent, write by write."""
        self.change: Callable[[bytes], bytes] = lambda reply: reply
        """What becomes of each reply on its way; b"" where it gets lost."""

    def send(self, data: bytes) -> None:
        self._require()
        self.sent.append(data)
        for reply in self._emulator.receive(data):
            self.comes(self.change(reply), self._delay_ns)

    def receive(self, within_ns: int) -> bytes:
        for unasked in self._emulator.due():
            self.comes(unasked)
        return super().receive(within_ns)
