"""What a node tells of itself: emergencies and heartbeats."""

from typing import Final

from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod_drivers.can_bus.cia401.objects import BOOTED, OPERATIONAL

# Error codes of emergencies (CiA 301, and CiA 401 for outputs); the first that fits counts.
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
_MOST: Final = 32
"""Emergencies that are remembered; who sends more of them has failed anyway."""


def meaning_of(code: int) -> DeviceFlag:
    """Return what an error code means; `DEVICE_FAILURE` where it has no meaning of its own."""
    for mask, kind, flag in _MEANINGS:
        if code & mask == kind:
            return flag
    return DeviceFlag.DEVICE_FAILURE


class NodeHealth:
    """Remembers what lasts of what a node has told: emergencies until it takes them back."""

    def __init__(self) -> None:
        self._active: set[int] = set()
        self._state = OPERATIONAL
        self._has_beaten = False
        self.restarted = False
        """Whether the node has started anew since `clear`: all its settings are lost."""
        self.flags: Flags = NO_FLAGS
        """What is the matter with the node."""
        self.must_be_set_up = False
        """Whether the node is no longer as it was set up: it started anew, or its watchdog did."""

    def clear(self) -> None:
        """Forget everything; to be called when the node has been set up."""
        self._active.clear()
        self._state, self._has_beaten, self.restarted = OPERATIONAL, False, False
        self._tell()

    def take_emergency(self, data: bytes) -> None:
        """Take the data of an emergency, whatever it is; may be called in the loop."""
        if len(data) < 3:
            return
        code, register = data[0] | data[1] << 8, data[2]
        if code & _CLASS == _ERROR_RESET:
            if register == 0:
                self._active.clear()
        elif len(self._active) < _MOST:
            self._active.add(code)
        self._tell()

    def take_heartbeat(self, data: bytes) -> None:
        """Take the data of a heartbeat, whatever it is; may be called in the loop.

        Of the first one only a restart counts: it may have been waiting in the node, which sends
        everything else before it, since before the node was set up.
        """
        if len(data) != 1:
            return
        state = data[0] & 0x7F
        self.restarted |= state == BOOTED
        if self._has_beaten:
            self._state = state
        self._has_beaten = True
        self._tell()

    def _tell(self) -> None:
        flags = {meaning_of(code) for code in self._active}
        if self.restarted:
            flags.add(DeviceFlag.RESTARTED)
        elif self._state != OPERATIONAL:
            flags.add(DeviceFlag.LOCAL_MODE)
        self.flags = frozenset(flags)
        self.must_be_set_up = self.restarted or DeviceFlag.WATCHDOG_TRIPPED in flags
