"""Exchanges with each device and their faults, as the loop publishes them once a second."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.telemetry.layout import DEVICE_WORDS
from piezod.telemetry.shared_map import SharedMap

_NUMBERS: Final = 3  # before the faults


class DeviceCounts(NamedTuple):
    """The counts of one device since the start of the loop."""

    exchanges: int  #: Exchanges on its bus, also those that failed; 0 for a device without a bus.
    rounds: int  #: Rounds of its worker; 0 for a device in the cycle.
    round_ns: int  #: Time that these rounds took, in ns.
    faults: Sequence[int]  #: Number of faults of each `devices.status.DeviceFlag`, in their order.


def put_device_counts(shared: SharedMap, device: int, counts: DeviceCounts) -> None:
    """Publish the counts of a device; its index is that in the configuration. Real-time safe."""
    words, at = shared.part("devices").cast("q"), device * DEVICE_WORDS
    for i, count in enumerate((*counts[:_NUMBERS], *counts.faults), at):
        words[i] = count


def device_counts_of(shared: SharedMap, faults: int) -> list[DeviceCounts]:
    """Return the counts of all devices, each with so many kinds of faults."""
    words = shared.part("devices").cast("q")
    begins = range(0, len(shared.layout.devices) * DEVICE_WORDS, DEVICE_WORDS)
    rows = (words[at : at + _NUMBERS + faults].tolist() for at in begins)
    return [DeviceCounts(row[0], row[1], row[2], row[_NUMBERS:]) for row in rows]
