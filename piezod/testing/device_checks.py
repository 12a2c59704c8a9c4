"""Driver contract: the checks of every device."""

from typing import Final

from piezod.devices.interface import Device
from piezod.testing.check_support import T0_NS, Check, DeviceFactory, active, assert_refused, opened
from piezod.testing.no_io import watch_io


def constructing_does_no_io(factory: DeviceFactory) -> None:
    """Constructing a device opens no file, no port and no process."""
    factory()  # the first construction imports modules, which reads files
    with watch_io() as events:
        factory()

    assert events == [], f"constructing the device did input or output: {events}"


def opening_tells_the_identity(factory: DeviceFactory) -> None:
    """Every part of the identity is a text that is not blank."""
    device = factory()
    try:
        identity = device.open()
    finally:
        device.close()

    assert all(part.strip() for part in identity), f"an empty part in {identity}"


def capabilities_make_sense(factory: DeviceFactory) -> None:
    """An open device has channels, each named once per side, and a rate above 0."""
    with opened(factory) as device:
        able = device.capabilities()

    assert able.inputs or able.outputs, "there are no channels"
    for channels in (able.inputs, able.outputs):
        assert len(set(channels)) == len(channels), f"a channel is named twice in {channels}"
    max_rate_hz = able.max_rate_hz
    assert max_rate_hz > 0, f"max_rate_hz is {max_rate_hz}"


def order_of_calls_is_enforced(factory: DeviceFactory) -> None:
    """A device answers and is activated only while it is open, and is opened only while closed."""
    device = factory()
    assert_refused("capabilities before open", device.capabilities)
    assert_refused("activate before open", lambda: device.activate(T0_NS))
    try:
        device.open()
        assert_refused("open of an open device", device.open)
    finally:
        device.close()
    assert_refused("capabilities after close", device.capabilities)
    assert_refused("activate after close", lambda: device.activate(T0_NS))


def ending_succeeds_at_any_time(factory: DeviceFactory) -> None:
    """Deactivate and close may be called before open, before activate, and twice."""
    _end_twice(factory())
    with opened(factory) as device:
        _end_twice(device)
    with active(factory) as device:
        _end_twice(device)


def _end_twice(device: Device) -> None:
    device.deactivate(T0_NS)
    device.deactivate(T0_NS)
    device.close()
    device.close()
    device.deactivate(T0_NS)


DEVICE_CHECKS: Final[tuple[Check, ...]] = (
    constructing_does_no_io,
    opening_tells_the_identity,
    capabilities_make_sense,
    order_of_calls_is_enforced,
    ending_succeeds_at_any_time,
)
