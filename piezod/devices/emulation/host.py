"""Service of an emulated device, with faults that make it absent for a while."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Final, Generic, TypeVar

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.far_end import End
from piezod.devices.emulation.faults import DEVICE_KINDS, ActiveFault, WireFaultKind, WireFaults

EndT = TypeVar("EndT", bound=End)
DeviceT = TypeVar("DeviceT")

_IMPOSTOR: Final = "99000099"
"""Serial number of the device that replaces the first one."""
_UNPLUGGED: Final = frozenset({WireFaultKind.DISCONNECT, WireFaultKind.IMPOSTOR})


class Host(ABC, Generic[EndT, DeviceT]):
    """Serves a device at its end of a wire or a bus until it has to stop.

    The device can be absent for several reasons at the same time; each reason ends by itself.

    Args:
        end: Its connection, not yet established.
        make: Makes the device, with a serial number.
        bench: The rig that it is connected to; its clock is that of the faults.
        faults: The wire faults.
        serial_number: Serial number of the device, "" for its default.
    """

    tick_ns: ClassVar[int]
    """Longest time between two steps without a request, in ns."""

    def __init__(
        self,
        end: EndT,
        make: Callable[[str], DeviceT],
        bench: SharedRig,
        faults: WireFaults,
        serial_number: str,
    ) -> None:
        self._end, self._make, self._bench, self._faults = end, make, bench, faults
        self._serial_number = serial_number
        self._device = make(serial_number)
        self._away: dict[WireFaultKind, int] = {}  # reason of each absence, and its end in ns

    def serve(self, ready: Callable[[str], None], stopping: Callable[[], bool]) -> None:
        """Serve the device.

        Args:
            ready: Called with the place as soon as a driver can connect.
            stopping: Returns whether to stop; called every `tick_ns` or more often.

        Raises:
            DeviceUnavailableError: If the end cannot be made.
        """
        self._end.appear()
        try:
            ready(self._end.place())
            while not stopping():
                self.advance(self.tick_ns)
        finally:
            self._end.vanish()

    def advance(self, within_ns: int) -> None:
        """Do all due work and handle requests for up to this time, in ns."""
        for hit in self._faults.at_once():
            self._befall(hit)
        if self._is_unplugged:
            threading.Event().wait(within_ns * 1e-9)  # never set: a plain wait
            self._go_on_alone()
        else:
            self._answer(within_ns)
        now_ns = self._bench.now_ns()
        for reason in [reason for reason, until_ns in self._away.items() if until_ns <= now_ns]:
            self._come_back(reason)

    @abstractmethod
    def _answer(self, within_ns: int) -> None:
        """Handle requests for up to this time and send due messages; nothing if it is off."""

    @abstractmethod
    def _forget(self) -> None:
        """Drop all unsent messages."""

    def _go_on_alone(self) -> None:
        """Let the device do what it does without a client, if it does anything."""

    def _leave(self, away: bool) -> None:
        """Go bus-off, or return to the bus, if there is one."""

    @property
    def _is_off(self) -> bool:
        return WireFaultKind.RESTART in self._away

    @property
    def _is_unplugged(self) -> bool:
        return not _UNPLUGGED.isdisjoint(self._away)

    def _next_hits(self) -> list[ActiveFault]:
        """Count a reply, apply the faults of the device, and return all faults of this reply."""
        hits = self._faults.next_reply()
        for hit in hits:
            self._befall(hit)
        return hits

    def _befall(self, hit: ActiveFault) -> None:
        if hit.kind not in DEVICE_KINDS:
            return
        self._forget()  # an absent device does not send what was under way
        self._away[hit.kind] = self._bench.now_ns() + round((hit.value or 0.0) * 1e9)
        if hit.kind == WireFaultKind.RESTART:
            # Without power its outputs fall to 0 V at once; its state is made anew on return.
            self._bench.plays_from(None)
            self._bench.drive_all([0.0] * self._bench.n_axes)
        elif hit.kind == WireFaultKind.BUS_OFF:
            self._leave(True)
        else:
            self._end.vanish()

    def _come_back(self, reason: WireFaultKind) -> None:
        del self._away[reason]
        if reason == WireFaultKind.BUS_OFF:
            self._leave(False)
        if reason == WireFaultKind.IMPOSTOR:
            self._serial_number = _IMPOSTOR
        if reason in {WireFaultKind.IMPOSTOR, WireFaultKind.RESTART}:
            self._device = self._make(self._serial_number)
        # Another reason may still keep it unplugged.
        if reason in _UNPLUGGED and not self._is_unplugged:
            self._end.appear()
