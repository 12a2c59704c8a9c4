"""A CAN bus for tests, in virtual time, with or without a node on it."""

from collections import deque
from collections.abc import Callable, Iterable

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.emulation.node import Node
from piezod_drivers.can_bus.frame import Frame
from tests.drivers.serial_line.scripted_line import US, TestTime


class FakeBus:
    """Implements `FrameBus`.

    Args:
        node: The node on the bus, if there is one.
        time: The clock.

    Attributes:
        sent: Every frame that was sent.
        fault: The fault that sending raises.
        delay_ns: Delay of each reply, in ns.
        on_send: Called with each frame that is sent.
        change: Returns the frames that replace a reply.
        opened_for: The identifiers that the bus was opened for.
        when_opened: Frames that come as soon as the bus is opened.
        told_of_stall: Number of calls of `mark_stalled`.
    """

    where = "a bus of this test"

    def __init__(self, node: Node | None = None, time: TestTime | None = None) -> None:
        self.node, self.time = node, time or TestTime()
        self.sent: list[Frame] = []
        self.fault: DeviceFlag | None = None
        self.delay_ns = 100 * US
        self.change: Callable[[Frame], list[Frame]] = lambda frame: [frame]
        self.on_send: Callable[[Frame], None] = lambda _frame: None
        self.opened_for: tuple[int, ...] = ()
        self.told_of_stall = 0
        self.when_opened: list[Frame] = []
        self._coming: deque[tuple[int, Frame]] = deque()

    def open(self, accepted: Iterable[int]) -> None:
        self.opened_for = tuple(accepted)
        self._coming.clear()
        self.comes(*self.when_opened)

    def close(self) -> None:
        pass

    def send(self, frame: Frame) -> None:
        if self.fault is not None:
            raise LineFault(self.fault, "the test demands it")
        self.sent.append(frame)
        self.on_send(frame)
        if self.node is not None:
            self._answer(self.node.receive(frame))

    def receive(self, within_ns: int) -> Frame | None:
        if self.node is not None:
            self._answer(self.node.due())
        until_ns = self.time.t_ns + within_ns
        if not self._coming or self._coming[0][0] > until_ns:
            self.time.t_ns = until_ns
            return None
        self.time.t_ns = max(self.time.t_ns, self._coming[0][0])
        return self._coming.popleft()[1]

    def mark_stalled(self) -> None:
        self.told_of_stall += 1

    def now_ns(self) -> int:
        return self.time.t_ns

    def take_noticed(self) -> set[DeviceFlag]:
        return set()

    def comes(self, *frames: Frame, after_ns: int = 0) -> None:
        """Let frames arrive after this time."""
        self._coming.extend((self.time.t_ns + after_ns, frame) for frame in frames)
        self._coming = deque(sorted(self._coming, key=lambda each: each[0]))

    def _answer(self, answers: list[Frame]) -> None:
        for answer in answers:
            self.comes(*self.change(answer), after_ns=self.delay_ns)
