"""Serves an emulated node on a bus and injects faults."""

from collections import deque
from collections.abc import Callable

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Serve
from piezod.devices.emulation.faults import WireFaultKind, WireFaults
from piezod.devices.emulation.host import Host
from piezod.devices.emulation.outbox import MOST_REPLIES
from piezod_drivers.can_bus.emulation.ends import BusEnd, end_at
from piezod_drivers.can_bus.emulation.node import Node
from piezod_drivers.can_bus.frame import Frame


class NodeHost(Host[BusEnd, Node]):
    """Serves a node on a bus until it is stopped; takes the arguments of `Host`.

    For the faults, each frame that the node sends is a reply.
    """

    tick_ns = 2_000_000

    def __init__(
        self,
        end: BusEnd,
        make: Callable[[str], Node],
        bench: SharedRig,
        faults: WireFaults,
        serial_number: str,
    ) -> None:
        super().__init__(end, make, bench, faults, serial_number)
        self._waiting: deque[tuple[int, Frame | bytes]] = deque(maxlen=MOST_REPLIES)

    def _answer(self, within_ns: int) -> None:
        if self._waiting:
            due_in_ns = self._waiting[0][0] - self._bench.now_ns()
            # A delayed frame must not wait for the next one to come.
            within_ns = min(max(due_in_ns, 0), within_ns)
        frames = self._end.receive(within_ns)
        if self._is_off:
            return
        answers = [answer for frame in frames for answer in self._device.receive(frame)]
        # After the replies: a periodic report must not overtake the reply to a request.
        answers += self._device.due()
        if not frames:
            self._bench.tick()
        now_ns = self._bench.now_ns()
        for answer in answers:
            self._put(answer, now_ns)
        # In order: a delayed frame also holds back those behind it, as a queue in the node does.
        while self._waiting and self._waiting[0][0] <= now_ns:
            part = self._waiting.popleft()[1]
            if isinstance(part, Frame):
                self._end.send(part)
            else:
                self._end.noise(part)

    def _put(self, frame: Frame, now_ns: int) -> None:
        hits = self._next_hits()
        if self._away:
            return
        late_ns, noise, copies = self._faults.fate(frame.data, hits)
        parts: list[Frame | bytes] = [
            self._device.foreign() for hit in hits if hit.kind == WireFaultKind.FOREIGN
        ]
        # On the bus, foreign frames and noise come before the reply that they disturb.
        parts += [noise] if noise else []
        parts += [frame._replace(data=data) for data in copies]
        self._waiting.extend((now_ns + late_ns, part) for part in parts)

    def _forget(self) -> None:
        self._waiting.clear()

    def _leave(self, away: bool) -> None:
        self._end.leave(away)


def serving(name: str, make: Callable[[SharedRig, str], Node]) -> Serve:
    """Return a function that serves a node at an slcan adapter's port or in a UDP group.

    Args:
        name: Name of the profile.
        make: Constructs the node, with a serial number or "" for its usual one.
    """

    def serve(
        bench: SharedRig,
        where: str,
        faults: WireFaults,
        serial_number: str,
        ready: Callable[[str], None],
        stopping: Callable[[], bool],
    ) -> None:
        end = end_at(where, name)
        host = NodeHost(end, lambda serial: make(bench, serial), bench, faults, serial_number)
        host.serve(ready, stopping)

    return serve
