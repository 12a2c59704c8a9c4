"""Serves an emulated device at the far end of a wire, faults included."""

import threading
from collections.abc import Callable
from typing import Final

from piezod.devices.emulation.bench import Bench
from piezod.devices.emulation.emulator import Emulator, HearsConnections
from piezod.devices.emulation.far_end import FarEnd
from piezod.devices.emulation.faults import BEFALL_DEVICE, FaultKind, Faults, Hit
from piezod.devices.emulation.outbox import Outbox

_TICK_NS: Final = 5_000_000
_IMPOSTOR: Final = "99000099"
"""Serial number of the device that comes instead of another one."""


class WireHost:
    """A device at the far end of a wire, until told to stop.

    Args:
        end: The far end; not there yet.
        make: Makes the device, with this serial number.
        bench: What it is connected to; its clock is that of the faults.
        faults: What goes wrong.
        serial_number: Of the device, "" for its usual one.
    """

    def __init__(
        self,
        end: FarEnd,
        make: Callable[[str], Emulator],
        bench: Bench,
        faults: Faults,
        serial_number: str,
    ) -> None:
        self._end, self._make, self._bench, self._faults = end, make, bench, faults
        self._serial_number = serial_number
        self._emulator = make(serial_number)
        self._outbox = Outbox(faults)
        self._away: FaultKind | None = None
        self._back_ns = 0

    def serve(self, ready: Callable[[str], None], stopping: Callable[[], bool]) -> None:
        """Serve.

        Args:
            ready: Told where, as soon as a driver can connect.
            stopping: Asked every 5 ms or more often.

        Raises:
            DeviceUnavailableError: If the far end cannot be made.
        """
        self._end.appear()
        try:
            ready(self._end.place())
            while not stopping():
                self._go_on()
        finally:
            self._end.vanish()

    def _go_on(self) -> None:
        for hit in self._faults.at_once():
            self._befall(hit)
        if self._away in {FaultKind.DISCONNECT, FaultKind.IMPOSTOR}:
            _pause()
        else:
            self._answer()
        if self._away is not None and self._bench.now_ns() >= self._back_ns:
            self._come_back(self._away)

    def _answer(self) -> None:
        now_ns = self._bench.now_ns()
        data = self._end.receive(self._outbox.wait_ns(now_ns, _TICK_NS))
        if self._end.take_connected() and isinstance(self._emulator, HearsConnections):
            self._emulator.connected()
        if self._away is not None:
            return  # it is off, and hears nothing
        replies = self._emulator.receive(data) if data else []
        replies += self._emulator.due()
        if not data:
            self._bench.tick()
        now_ns = self._bench.now_ns()
        for reply in replies:
            hits = self._faults.next_reply()
            for hit in hits:
                self._befall(hit)
            if self._away is not None:
                return
            self._outbox.put(reply, hits, now_ns)
        if sent := self._outbox.take(now_ns):
            self._end.send(sent)

    def _befall(self, hit: Hit) -> None:
        if hit.kind not in BEFALL_DEVICE:
            return
        self._outbox.clear()
        self._away = hit.kind
        self._back_ns = self._bench.now_ns() + round((hit.value or 0.0) * 1e9)
        if hit.kind == FaultKind.RESTART:
            self._bench.drive_all([0.0] * self._bench.n_axes)
        else:
            self._end.vanish()

    def _come_back(self, why: FaultKind) -> None:
        self._away = None
        if why == FaultKind.IMPOSTOR:
            self._serial_number = _IMPOSTOR
        if why != FaultKind.DISCONNECT:
            self._emulator = self._make(self._serial_number)
        if why != FaultKind.RESTART:
            self._end.appear()


def _pause() -> None:
    threading.Event().wait(_TICK_NS * 1e-9)
