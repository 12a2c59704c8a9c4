"""Errors of the kernel as faults of a line, and as refusals to open a device."""

import errno
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.bus.port_holder import holder_of
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError, PortHeldError

_FLAGS: Final = {
    errno.ENODEV: DeviceFlag.DISCONNECTED,
    errno.ENXIO: DeviceFlag.DISCONNECTED,
    errno.ENOENT: DeviceFlag.DISCONNECTED,
    errno.EBADF: DeviceFlag.DISCONNECTED,
    errno.ESHUTDOWN: DeviceFlag.DISCONNECTED,
    errno.EBUSY: DeviceFlag.BUSY,
    errno.EACCES: DeviceFlag.PORT_SHARED,
    errno.EPERM: DeviceFlag.PORT_SHARED,
    errno.EINVAL: DeviceFlag.WRONG_REQUEST,
    errno.ERANGE: DeviceFlag.WRONG_REQUEST,
    errno.ETIMEDOUT: DeviceFlag.LATE_REPLY,
}
"""Flag of each error number; any other one is a failure of the device."""


def fault_of(number: int, what: str) -> LineFault:
    """Return the fault for an error number; `what` names the device and the attempt."""
    flag = _FLAGS.get(number, DeviceFlag.DEVICE_FAILURE)
    return LineFault(flag, f"{what}: {_name(number)}")


def refusal(path: str, number: int, absent: str, group: str) -> DeviceUnavailableError:
    """Return the error for a device that cannot be opened.

    Args:
        path: Its file.
        number: Error number.
        absent: What to do if it is not there.
        group: What to do if this user may not use it.
    """
    if number in {errno.ENOENT, errno.ENODEV, errno.ENXIO}:
        return DeviceUnavailableError(f"no device {path}: {absent}")
    if number in {errno.EACCES, errno.EPERM, errno.EROFS}:
        return DeviceUnavailableError(f"no access to {path} ({_name(number)}): {group}")
    if number == errno.EBUSY:
        return held(path)
    return DeviceUnavailableError(f"{path} cannot be opened: {_name(number)}")


def held(path: str) -> PortHeldError:
    """Return the error for a device that another program uses."""
    holder = holder_of(path)
    who = f" ({holder})" if holder else ""
    return PortHeldError(f"{path} is used by another program{who}: end it")


def _name(number: int) -> str:
    return errno.errorcode.get(number, f"error {number}")
