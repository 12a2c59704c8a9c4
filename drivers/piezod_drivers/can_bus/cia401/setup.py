"""Prepares a node by SDO, before the loop runs: identity, process data, watchdog."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.devices.interface import Identity
from piezod.errors import DeviceError
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cia401.sdo_client import SdoAccess, SdoRefusedError

_ID_MASK: Final = 0x7FF
_WORD_MASK: Final = 0xFFFF


class Pdo(NamedTuple):
    """A PDO of a node, as requested or as found.

    Attributes:
        settings: Index of its communication parameters.
        mapping: Index of its mapping.
        transmission: Transmission type.
        entries: Entries of its mapping.
    """

    settings: int
    mapping: int
    transmission: int
    entries: tuple[int, ...]

    @classmethod
    def for_outputs(cls, number: int, outputs: Sequence[int]) -> "Pdo":
        """Return the receive PDO that sets outputs as soon as it arrives."""
        entries = tuple(objects.mapped(objects.OUTPUT, output) for output in outputs)
        i = number - 1
        return cls(objects.RPDO + i, objects.RPDO_MAPPING + i, objects.AT_ONCE, entries)

    @classmethod
    def for_inputs(cls, number: int, inputs: Sequence[int], outputs: Sequence[int]) -> "Pdo":
        """Return the transmit PDO that carries inputs, and outputs, at each SYNC."""
        read = tuple(objects.mapped(objects.INPUT, one) for one in inputs)
        read_back = tuple(objects.mapped(objects.OUTPUT, output) for output in outputs)
        i = number - 1
        mapping = objects.TPDO_MAPPING + i
        return cls(objects.TPDO + i, mapping, objects.EVERY_SYNC, read + read_back)


class PdoLayout(NamedTuple):
    """The positions of channels in a PDO of the node.

    Attributes:
        id: Identifier of the PDO.
        positions: Index of the word of each channel.
        fill: Value of each word that belongs to no channel of ours; 0 for the others.
    """

    id: int
    positions: tuple[int, ...]
    fill: tuple[int, ...]


def identify(access: SdoAccess) -> Identity:
    """Read the identity of a node.

    Raises:
        DeviceError: If it is no CiA 401 node.
        LineFault: If it does not reply.
    """
    try:
        # The low word is the device profile, the high word lists kinds of inputs and outputs.
        kind = access.number(objects.DEVICE_TYPE) & _WORD_MASK
        vendor, product, revision, serial = (_identity_number(access, i) for i in range(1, 5))
    except SdoRefusedError as error:
        raise DeviceError(f"{error}, but every CANopen node has this object") from error
    if kind != objects.PROFILE:
        what = f"the node has device profile {kind}, expected {objects.PROFILE} (analogue I/O)"
        raise DeviceError(f"{what}: check the node number")
    name = access.text(objects.NAME) or f"product 0x{product:08X}"
    software = access.text(objects.SOFTWARE) or f"revision 0x{revision:08X}"
    return Identity(f"vendor 0x{vendor:08X}", name, str(serial), software)


def has_object(access: SdoAccess, index: int, number: int) -> bool:
    """Return whether a node has a readable object.

    Raises:
        LineFault: If it does not reply.
    """
    try:
        access.read(index, number)
    except SdoRefusedError:
        return False
    return True


def prepare(access: SdoAccess, pdos: Sequence[Pdo]) -> list[PdoLayout]:
    """Configure PDOs that differ, and return the positions of the channels in each.

    A node with a fixed mapping is used with that mapping, if it has all channels. The outputs keep
    their values.

    Raises:
        DeviceError: If the node cannot be configured this way.
        LineFault: If it does not reply.
    """
    try:
        if any(_current(access, pdo) != pdo for pdo in pdos):
            # A mapping may only be changed in the state pre-operational. A node that already has
            # the right PDOs keeps running: some nodes change their outputs when their state
            # changes.
            access.send_nmt(objects.PREPARE)
            for pdo in pdos:
                _configure(access, pdo)
        return [_layout(access, pdo) for pdo in pdos]
    except SdoRefusedError as error:
        raise DeviceError(f"the node cannot be set up: {error}") from error


def _current(access: SdoAccess, pdo: Pdo) -> Pdo | None:
    if access.number(pdo.settings, 1) & objects.DISABLED:
        return None
    transmission = access.number(pdo.settings, 2)
    return pdo._replace(transmission=transmission, entries=_entries(access, pdo))


def _entries(access: SdoAccess, pdo: Pdo) -> tuple[int, ...]:
    count = access.number(pdo.mapping)
    # Eight at most: a PDO carries four words, and a wrong number must not cause 255 requests.
    return tuple(access.number(pdo.mapping, i + 1) for i in range(min(count, 8)))


def _configure(access: SdoAccess, pdo: Pdo) -> None:
    # The identifier that the node uses is kept.
    identifier = access.number(pdo.settings, 1) & ~objects.DISABLED
    # Order of CiA 301: disable the PDO, clear the mapping, write its entries, then their number.
    access.write(pdo.settings, 1, identifier | objects.DISABLED, 4)
    access.write(pdo.settings, 2, pdo.transmission, 1)
    try:
        access.write(pdo.mapping, 0, 0, 1)
        for i, entry in enumerate(pdo.entries):
            access.write(pdo.mapping, i + 1, entry, 4)
        access.write(pdo.mapping, 0, len(pdo.entries), 1)
    except SdoRefusedError as error:
        # A node with a fixed mapping refuses the first write, so its mapping is unchanged.
        if not set(pdo.entries) <= set(_entries(access, pdo)):
            what = f"{error}; its mapping is fixed and lacks a channel"
            raise DeviceError(f"{what}: set another rpdo or tpdo") from error
    access.write(pdo.settings, 1, identifier, 4)


def _layout(access: SdoAccess, pdo: Pdo) -> PdoLayout:
    entries = _entries(access, pdo)
    if any(entry & 0xFF != objects.WORD_BITS for entry in entries):
        what = f"PDO 0x{pdo.settings:04X} of the node has entries of other than 16 bits"
        raise DeviceError(f"{what}: set another rpdo or tpdo")
    # Outputs of others in the same PDO must be sent with the values that they have now.
    foreign = set(entries) - set(pdo.entries)
    fill = tuple(
        access.number(entry >> 16, entry >> 8 & 0xFF) if entry in foreign else 0
        for entry in entries
    )
    positions = tuple(entries.index(entry) for entry in pdo.entries)
    return PdoLayout(access.number(pdo.settings, 1) & _ID_MASK, positions, fill)


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
        LineFault: If it does not reply.
    """
    try:
        for output, code in safe_codes:
            n_bytes = len(access.read(objects.ERROR_VALUE, output))  # 2 or 4, nodes differ
            access.write(objects.ERROR_VALUE, output, code, n_bytes)
            n_bytes = len(access.read(objects.ERROR_MODE, output))
            # The value before the mode: the node must never hold mode 1 with an old error value.
            access.write(objects.ERROR_MODE, output, 1, n_bytes)
        access.write(objects.CONSUMER_HEARTBEAT, 1, host << 16 | watchdog_ms, 4)
    except SdoRefusedError as error:
        what = "the node refuses to supervise this host"
        raise DeviceError(f"{what}: {error}; leave out safe_code") from error


def disarm_watchdog(access: SdoAccess) -> None:
    """Stop a node from expecting a heartbeat, so that its outputs hold.

    Raises:
        LineFault: If it does not reply.
    """
    try:
        access.write(objects.CONSUMER_HEARTBEAT, 1, 0, 4)
    except SdoRefusedError:
        return  # it has no such watchdog


def start_heartbeat(access: SdoAccess, heartbeat_ms: int) -> bool:
    """Start the heartbeat of a node; return whether it now sends one.

    Raises:
        LineFault: If it does not reply.
    """
    try:
        access.write(objects.PRODUCER_HEARTBEAT, 0, heartbeat_ms, 2)
    except SdoRefusedError:
        return False
    return heartbeat_ms > 0


def _identity_number(access: SdoAccess, number: int) -> int:
    try:
        return access.number(objects.IDENTITY, number)
    except SdoRefusedError as error:
        if error.is_missing:
            return 0
        raise
