"""Common parts of the checks of the driver contract."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, TypeAlias, TypeVar

from piezod.devices.interface import Device
from piezod.errors import DeviceError

DeviceT = TypeVar("DeviceT", bound=Device)
DeviceFactory: TypeAlias = Callable[[], Device]
Check: TypeAlias = Callable[[DeviceFactory], None]

T0_NS: Final = 1_000_000_000  # start of the simulated clock of every check


@contextmanager
def opened(factory: Callable[[], DeviceT]) -> Iterator[DeviceT]:
    """Construct and open a device, and close it in any case."""
    device = factory()
    try:
        device.open()
        yield device
    finally:
        device.close()


@contextmanager
def active(factory: Callable[[], DeviceT]) -> Iterator[DeviceT]:
    """Construct, open and activate a device at `T0_NS`, and close it in any case."""
    with opened(factory) as device:
        device.activate(T0_NS)
        yield device


def assert_refused(what: str, call: Callable[[], object]) -> None:
    """Assert that a call out of order raises DeviceError."""
    try:
        call()
    except DeviceError:
        return
    raise AssertionError(f"{what} should raise DeviceError, but returned")
