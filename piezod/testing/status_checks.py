"""Driver contract: the checks of devices that report their status."""

from collections.abc import Callable
from typing import Final, Protocol, TypeAlias

from piezod.devices.interface import Device
from piezod.devices.status import DeviceFlag, TellsStatus
from piezod.testing.check_support import T0_NS, active, assert_refused, opened


class TellingDevice(Device, TellsStatus, Protocol):
    """A device that reports its status."""


TellingFactory: TypeAlias = Callable[[], TellingDevice]

_CYCLES: Final = 5
_PERIOD_NS: Final = 1_000_000


def status_needs_an_open_device(factory: TellingFactory) -> None:
    """A closed device refuses the request for its status."""
    device = factory()
    assert_refused("status before open", lambda: device.status(T0_NS))
    with opened(lambda: device):
        pass
    assert_refused("status after close", lambda: device.status(T0_NS))


def every_channel_has_its_flags(factory: TellingFactory) -> None:
    """The status has the inputs first, then the outputs, in the active and the inactive state."""
    with opened(factory) as device:
        _assert_flags(device, T0_NS)
    with active(factory) as device:
        for cycle in range(1, _CYCLES):
            _assert_flags(device, T0_NS + cycle * _PERIOD_NS)


def _assert_flags(device: TellingDevice, now_ns: int) -> None:
    able, status = device.capabilities(), device.status(now_ns)
    n_channels = len(able.inputs) + len(able.outputs)
    assert len(status) == n_channels, f"flags of {len(status)} channels, expected {n_channels}"
    for flags in status:
        assert all(isinstance(flag, DeviceFlag) for flag in flags), f"not only flags: {flags}"


STATUS_CHECKS: Final = (
    status_needs_an_open_device,
    every_channel_has_its_flags,
)
