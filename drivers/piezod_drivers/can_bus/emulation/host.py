"""Serves an emulated node on a bus, faults included."""

from collections import deque
from collections.abc import Callable
from typing import Final

from piezod.devices.emulation.bench import Bench
from piezod.devices.emulation.faults import FaultKind, Faults, Hit
from piezod_drivers.can_bus.emulation.ends import BusEnd, wait
from piezod_drivers.can_bus.emulation.node import Node
from piezod_drivers.can_bus.frame import Frame

_TICK_NS: Final = 2_000_000
_MOST_FRAMES: Final = 4096
_IMPOSTOR: Final = "99000099"
_AWAY: Final = frozenset(
    {FaultKind.DISCONNECT, FaultKind.IMPOSTOR, FaultKind.RESTART, FaultKind.BUS_OFF}
)
_UNPLUGGED: Final = frozenset({FaultKind.DISCONNECT, FaultKind.IMPOSTOR})


class NodeHost:
    """A node on a bus, until told to stop.

    Args:
        end: What connects it to the bus; not there yet.
        make: Makes the node, with this serial number.
        bench: What it is connected to; its clock is that of the faults.
        faults: What goes wrong with each frame that the node sends.
        serial_number: Of the node, "" for its usual one.
    """

    def __init__(
        self,
        end: BusEnd,
        make: Callable[[str], Node],
        bench: Bench,
        faults: Faults,
        serial_number: str,
    ) -> None:
        self._end, self._make, self._bench, self._faults = end, make, bench, faults
        self._serial_number = serial_number
        self._node = make(serial_number)
        self._waiting: deque[tuple[int, Frame]] = deque(maxlen=_MOST_FRAMES)
        self._away: FaultKind | None = None
        self._back_ns = 0

    def serve(self, ready: Callable[[str], None], stopping: Callable[[], bool]) -> None:
        """Serve.

        Args:
            ready: Told where, as soon as a driver can connect.
            stopping: Asked every few milliseconds.

        Raises:
            DeviceUnavailableError: If the bus cannot be joined.
        """
        self._end.appear()
        try:
            ready(self._end.place())
            while not stopping():
                self.go_on(_TICK_NS)
        finally:
            self._end.vanish()

    def go_on(self, within_ns: int) -> None:
        """Do what is due, and what comes within a time; wait no longer."""
        for hit in self._faults.at_once():
            self._befall(hit)
        if self._away in _UNPLUGGED:
            wait(within_ns)
        else:
            self._answer(within_ns)
        if self._away is not None and self._bench.now_ns() >= self._back_ns:
            self._come_back(self._away)

    def _answer(self, within_ns: int) -> None:
        now_ns = self._bench.now_ns()
        if self._waiting:
            within_ns = min(max(self._waiting[0][0] - now_ns, 0), within_ns)
        frames = self._end.receive(within_ns)
        if self._away == FaultKind.RESTART:
            return  # it is off, and hears nothing
        answers = [answer for frame in frames for answer in self._node.receive(frame)]
        answers += self._node.due()
        if not frames:
            self._bench.tick()
        now_ns = self._bench.now_ns()
        for answer in answers:
            self._put(answer, now_ns)
        while self._waiting and self._waiting[0][0] <= now_ns:
            self._end.send(self._waiting.popleft()[1])

    def _put(self, frame: Frame, now_ns: int) -> None:
        due_ns, copies = now_ns, 1
        for hit in self._faults.next_reply():
            match hit.kind:
                case FaultKind.LATE:
                    due_ns += round((hit.value or 0.0) * 1e9)
                case FaultKind.LOST:
                    copies = 0
                case FaultKind.DUPLICATED:
                    copies *= 2
                case FaultKind.GARBLED:
                    frame = self._garbled(frame, hit.value)
                case FaultKind.PARTIAL:
                    n = len(frame.data) // 2 if hit.value is None else int(hit.value)
                    frame = frame._replace(data=frame.data[:n])
                case FaultKind.NOISE:
                    self._end.noise(self._faults.random_bytes(int(hit.value or 0)))
                case FaultKind.FOREIGN:
                    self._waiting.append((due_ns, self._node.foreign()))
                case _:
                    self._befall(hit)
        if self._away is None:
            self._waiting.extend([(due_ns, frame)] * copies)

    def _garbled(self, frame: Frame, bit: float | None) -> Frame:
        n_bits = 8 * len(frame.data)
        if not n_bits:
            return frame
        place = self._faults.random_below(n_bits) if bit is None else int(bit) % n_bits
        flipped = bytearray(frame.data)
        flipped[place // 8] ^= 1 << place % 8
        return frame._replace(data=bytes(flipped))

    def _befall(self, hit: Hit) -> None:
        if hit.kind not in _AWAY:
            return
        self._waiting.clear()
        self._away = hit.kind
        self._back_ns = self._bench.now_ns() + round((hit.value or 0.0) * 1e9)
        if hit.kind == FaultKind.RESTART:
            self._bench.drive_all([0.0] * self._bench.n_axes)
        elif hit.kind == FaultKind.BUS_OFF:
            self._end.leave(True)
        else:
            self._end.vanish()

    def _come_back(self, why: FaultKind) -> None:
        self._away = None
        if why == FaultKind.IMPOSTOR:
            self._serial_number = _IMPOSTOR
        if why in {FaultKind.IMPOSTOR, FaultKind.RESTART}:
            self._node = self._make(self._serial_number)
        if why == FaultKind.BUS_OFF:
            self._end.leave(False)
        elif why in _UNPLUGGED:
            self._end.appear()
