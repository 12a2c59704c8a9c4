"""An slcan adapter with a queue, in the process of a test."""

from collections import deque

from piezod_drivers.can_bus.emulation.ends import Adapter
from piezod_drivers.can_bus.frame import Frame


class QueueingAdapter:
    """Implements `Emulator`: an adapter with a queue for frames that it cannot send.

    Attributes:
        on_bus: Frames that have been on the bus.
        stuck: Whether no frame is sent.
        silent: Whether it acknowledges nothing.
    """

    def __init__(self) -> None:
        self.adapter = Adapter()
        self.on_bus: list[Frame] = []
        self.queue: deque[Frame] = deque()
        self.stuck = self.silent = False
        self.commands: list[bytes] = []

    def receive(self, data: bytes) -> list[bytes]:
        if b"C\r" in data:
            self.queue.clear()
        frames, answers = self.adapter.take(data)
        self.commands.append(data)
        self.queue.extend(frames)
        while self.queue and not self.stuck:
            self.on_bus.append(self.queue.popleft())
        return [answers] if answers and not self.silent else []

    def due(self) -> list[bytes]:
        return []
