"""Tells why lost devices cannot be opened again."""

from collections.abc import Mapping

from piezod.config.faults import Fault
from piezod.control.watch.bus import AT_ONCE
from piezod.devices.reconnecting import ReconnectingDevice
from piezod.telemetry.record import StageEvent


class Absences:
    """Makes an event of each new reason why a lost device cannot be opened again.

    Args:
        devices: The devices that can be lost, by name.
    """

    def __init__(self, devices: Mapping[str, ReconnectingDevice]) -> None:
        self._devices = devices
        self._told = dict.fromkeys(devices, "")

    def take_events(self, t_ns: int) -> list[StageEvent]:
        """Return the events since the last call; once a second is enough. Real-time safe.

        Args:
            t_ns: Instant of the cycle, in ns.
        """
        events = []
        for name, device in self._devices.items():
            obstacle, why = device.obstacle, device.absent
            if why and why != self._told[name]:
                fault = AT_ONCE[obstacle] if obstacle else Fault.B1
                events.append(StageEvent(t_ns, "error", "device", f"{name}: {why}", fault))
            self._told[name] = why
        return events
