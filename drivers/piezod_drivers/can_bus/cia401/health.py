"""The state that a node reports by itself, in emergencies and heartbeats."""

from typing import Final

from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod_drivers.can_bus.cia401.objects import BOOTED, OPERATIONAL

# Mask, error code and meaning of emergencies (CiA 301; outputs: CiA 401). The first match counts.
_MEANINGS: Final = (
    (0xFFFF, 0x2320, DeviceFlag.SHORT_OR_OPEN),  # short circuit at outputs
    (0xFFFF, 0x2330, DeviceFlag.SHORT_OR_OPEN),  # load dump at outputs
    (0xF000, 0x2000, DeviceFlag.OVERLOAD),  # current
    (0xF000, 0x4000, DeviceFlag.OVER_TEMPERATURE),
    (0xFFFF, 0x8130, DeviceFlag.WATCHDOG_TRIPPED),  # no heartbeat from the host
    (0xFFFF, 0x8140, DeviceFlag.BUS_OFF),  # recovered from bus off
    (0xFF00, 0x8100, DeviceFlag.NOT_SENT),  # its controller is passive, or overrun
    (0xFF00, 0x8200, DeviceFlag.WRONG_REQUEST),  # process data of a wrong length
)
_ERROR_RESET: Final = 0x0000
_CLASS: Final = 0xFF00
_MAX_EMERGENCIES: Final = 32
"""Highest number of emergencies that are kept; a node with more has failed anyway."""


def meaning_of(code: int) -> DeviceFlag:
    """Return the meaning of an error code; `DEVICE_FAILURE` for a code without its own."""
    for mask, kind, flag in _MEANINGS:
        if code & mask == kind:
            return flag
    return DeviceFlag.DEVICE_FAILURE


class NodeHealth:
    """Keeps the reported state of a node; an emergency lasts until the node clears it."""

    def __init__(self) -> None:
        self._active: set[int] = set()
        self._state = OPERATIONAL
        self._had_heartbeat = False
        self.restarted = False
        """Whether the node has restarted since `clear`; then all its settings are lost."""
        self.flags: Flags = NO_FLAGS
        """Flags of the faults that the node reports."""
        self.needs_setup = False
        """Whether the node's setup is lost: it has restarted, or its watchdog has tripped."""

    def clear(self) -> None:
        """Forget everything; call it when the node has been set up."""
        self._active.clear()
        self._state, self._had_heartbeat, self.restarted = OPERATIONAL, False, False
        self._update()

    def take_emergency(self, data: bytes) -> None:
        """Process the data of an emergency, valid or not. Real-time safe."""
        if len(data) < 3:
            return
        code, register = data[0] | data[1] << 8, data[2]
        if code & _CLASS == _ERROR_RESET:
            # "Error reset" with a register other than 0: one error is over, but others remain.
            if register == 0:
                self._active.clear()
        elif len(self._active) < _MAX_EMERGENCIES:
            self._active.add(code)
        self._update()

    def take_heartbeat(self, data: bytes) -> None:
        """Process the data of a heartbeat, valid or not. Real-time safe.

        The first heartbeat only counts if it reports a restart. It may be older than the setup: a
        node sends all other frames first.
        """
        if len(data) != 1:
            return
        # The top bit is a toggle bit of the older node guarding protocol.
        state = data[0] & 0x7F
        self.restarted |= state == BOOTED
        if self._had_heartbeat:
            self._state = state
        self._had_heartbeat = True
        self._update()

    def _update(self) -> None:
        flags = {meaning_of(code) for code in self._active}
        if self.restarted:
            flags.add(DeviceFlag.RESTARTED)
        # Another master has stopped the node; it ignores process data.
        elif self._state != OPERATIONAL:
            flags.add(DeviceFlag.LOCAL_MODE)
        self.flags = frozenset(flags)
        self.needs_setup = self.restarted or DeviceFlag.WATCHDOG_TRIPPED in flags
