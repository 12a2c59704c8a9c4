"""Publishes how many exchanges each device had, and which of them failed."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.interface import Device
from piezod.devices.status import DeviceFlag
from piezod.telemetry.device_counts import DeviceCounts, put_device_counts
from piezod.telemetry.shared_map import SharedMap


@runtime_checkable
class CountsExchanges(Protocol):
    """A device that counts its exchanges, as each device on a bus does."""

    exchanges: int  #: Number of exchanges, also those that failed.
    exchange_faults: Mapping[DeviceFlag, int]  #: Number of faults of every flag.


class DeviceCounters:
    """Publishes the counts of the devices.

    Args:
        shared: The memory, writable.
        devices: The devices by name, as their drivers made them.
        used: The same devices as the loop uses them: themselves, or wrappers of them.
    """

    def __init__(
        self, shared: SharedMap, devices: Mapping[str, Device], used: Mapping[str, Device]
    ) -> None:
        self._shared = shared
        self._devices = [
            (shared.layout.devices.index(name), _counting(device), _worker(used[name]))
            for name, device in devices.items()
        ]

    def publish(self) -> None:
        """Publish the counts; once a second is enough. Real-time safe."""
        for place, device, worker in self._devices:
            exchanges, faults = (
                (device.exchanges, device.exchange_faults.values()) if device else (0, ())
            )
            rounds, rounds_ns = (worker.rounds, worker.rounds_ns) if worker else (0, 0)
            counts = DeviceCounts(exchanges, rounds, rounds_ns, (*faults,))
            put_device_counts(self._shared, place, counts)


def _counting(device: Device) -> CountsExchanges | None:
    return device if isinstance(device, CountsExchanges) else None


def _worker(used: Device) -> DeviceWorker | None:
    return used if isinstance(used, DeviceWorker) else None
