"""Prepares a node by SDO, before the loop runs: identity, watchdog, heartbeat.

Every function raises `LineFault` if the node does not reply.
"""

from collections.abc import Sequence
from typing import Final

from piezod.devices.interface import Identity
from piezod.errors import DeviceError
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cia401.sdo_client import SdoAccess, SdoRefusedError

_WORD_MASK: Final = 0xFFFF
_HOST_MASK: Final = 0xFF_0000
"""Node number in an entry of object 0x1016; the low word is the time."""


def identify(access: SdoAccess) -> Identity:
    """Read the identity of a node.

    Raises:
        DeviceError: If it is no CiA 401 node.
    """
    try:
        # The low word is the device profile, the high word lists kinds of inputs and outputs.
        kind = access.number(objects.DEVICE_TYPE, 0, 4) & _WORD_MASK
        vendor, product, revision, serial = (_identity_number(access, i) for i in range(1, 5))
    except SdoRefusedError as error:
        raise DeviceError(f"{error}, but every CANopen node has this object") from error
    if kind != objects.PROFILE:
        what = f"the node has device profile {kind}, expected {objects.PROFILE} (analogue I/O)"
        raise DeviceError(f"{what}: check the node number")
    name = access.text(objects.NAME) or f"product 0x{product:08X}"
    software = access.text(objects.SOFTWARE) or f"revision 0x{revision:08X}"
    return Identity(f"vendor 0x{vendor:08X}", name, str(serial), software)


def check_words(access: SdoAccess, index: int, numbers: Sequence[int]) -> None:
    """Check that the loop can read channels by SDO.

    Args:
        access: The node.
        index: Index of the object that has the words.
        numbers: Sub-index of each channel.

    Raises:
        DeviceError: If the node does not let one be read, or it has not 16 bits.
    """
    try:
        for number in numbers:
            access.require_word(index, number)
    except SdoRefusedError as error:
        raise DeviceError(f"{error}: check the numbers of the channels") from error


def has_watchdog(access: SdoAccess, safe_codes: Sequence[tuple[int, int]]) -> bool:
    """Return whether a node can set safe codes; False if there are none.

    Args:
        access: The node.
        safe_codes: Number and error value of each output.
    """
    needed = [(objects.ERROR_VALUE, output) for output, _ in safe_codes]
    needed += [(objects.CONSUMER_HEARTBEAT, 1)] if safe_codes else []
    return bool(needed) and all(_has_object(access, *each) for each in needed)


def _has_object(access: SdoAccess, index: int, number: int) -> bool:
    try:
        access.read(index, number)
    except SdoRefusedError:
        return False
    return True


def arm_watchdog(
    access: SdoAccess, host: int, watchdog_ms: int, safe_codes: Sequence[tuple[int, int]]
) -> None:
    """Configure a node to set safe codes when this host falls silent.

    Args:
        access: The node.
        host: Node number of this host, whose heartbeat the node expects.
        watchdog_ms: Longest time between two heartbeats, in ms.
        safe_codes: Number and error value of each output.

    Raises:
        DeviceError: If the node refuses.
    """
    try:
        for output, code in safe_codes:
            # The value before the mode: the node must never hold mode 1 with an old error value.
            access.write_sized(objects.ERROR_VALUE, output, code, (2, 4))  # nodes differ
            access.write_sized(objects.ERROR_MODE, output, 1, (1,))
        # A node may refuse a new time, or not return from it, while it supervises a host: after a
        # crash of this one, or for another master. It stops with the time 0 for the same host.
        supervised = access.number(objects.CONSUMER_HEARTBEAT, 1, 4) & _HOST_MASK
        access.write(objects.CONSUMER_HEARTBEAT, 1, supervised, 4)
        access.write(objects.CONSUMER_HEARTBEAT, 1, host << 16 | watchdog_ms, 4)
    except SdoRefusedError as error:
        what = "the node refuses to supervise this host"
        raise DeviceError(f"{what}: {error}; leave out safe_code") from error


def disarm_watchdog(access: SdoAccess, host: int) -> None:
    """Stop a node from expecting a heartbeat, so that its outputs hold.

    Args:
        access: The node.
        host: Node number of this host. Some nodes only stop supervising a host that is named, with
            the time 0; the entry 0 leaves the watchdog running there.
    """
    try:
        access.write(objects.CONSUMER_HEARTBEAT, 1, host << 16, 4)
    except SdoRefusedError:
        return  # it has no such watchdog


def start_heartbeat(access: SdoAccess, heartbeat_ms: int) -> bool:
    """Start the heartbeat of a node; return whether it now sends one."""
    try:
        access.write(objects.PRODUCER_HEARTBEAT, 0, heartbeat_ms, 2)
    except SdoRefusedError:
        return False
    return heartbeat_ms > 0


def _identity_number(access: SdoAccess, number: int) -> int:
    try:
        return access.number(objects.IDENTITY, number, 4)
    except SdoRefusedError as error:
        if error.is_missing:
            return 0
        raise
