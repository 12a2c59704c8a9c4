"""Service of an emulated device at the device end of a wire, with faults."""

from collections.abc import Callable

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator, HearsConnections, Streams
from piezod.devices.emulation.far_end import FarEnd
from piezod.devices.emulation.faults import ON_A_BUS, ActiveFault, WireFaults
from piezod.devices.emulation.host import Host
from piezod.devices.emulation.outbox import Outbox
from piezod.devices.emulation.two_port_end import TwoPortEnd


class WireHost(Host[FarEnd, Emulator]):
    """Serves a device at the device end of a wire; takes the arguments of `Host`.

    Faults that need a bus are ignored.
    """

    tick_ns = 5_000_000

    def __init__(
        self,
        end: FarEnd,
        make: Callable[[str], Emulator],
        bench: SharedRig,
        faults: WireFaults,
        serial_number: str,
    ) -> None:
        super().__init__(end, make, bench, faults, serial_number)
        self._outbox = Outbox(faults)

    def _answer(self, within_ns: int) -> None:
        data = self._end.receive(self._outbox.wait_ns(self._bench.now_ns(), within_ns))
        if self._end.take_connected() and isinstance(self._device, HearsConnections):
            self._device.connected()
        if self._is_off:
            return
        replies = self._device.receive(data) if data else []
        replies += self._device.due()
        if isinstance(self._end, TwoPortEnd) and isinstance(self._device, Streams):
            self._end.pass_on(self._device)
        if not data:  # idle: use the time for the physics
            self._bench.tick()
        now_ns = self._bench.now_ns()
        for reply in replies:
            hits = self._next_hits()
            if self._away:
                break  # an absent device sends none of its further replies
            self._outbox.put(reply, hits, now_ns)
        if sent := self._outbox.take(now_ns):
            self._end.send(sent)

    def _forget(self) -> None:
        self._outbox.clear()

    def _befall(self, hit: ActiveFault) -> None:
        if hit.kind not in ON_A_BUS:
            super()._befall(hit)
